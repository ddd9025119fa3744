/* Triangle meshes seen as closed surfaces of pieces. Include it after check.h. Vertices with one `key` are one point. */
#ifndef CHECK_CLOSED_H
#define CHECK_CLOSED_H

#include "check.h"

typedef struct check_closed {
    const dgfem_vec3 *positions;
    const int *triangles;
    int triangle_count, vertex_count;
    const int *key; /* [vertex_count] */
} check_closed;

static inline int check_closed_key(const check_closed *shell, int corner) { return shell->key[shell->triangles[corner]]; }

/* Directed edges without an opposite one: 0 where the surface is closed. By sorting. */
static inline int check_closed_compare(const void *a, const void *b) {
    return memcmp(a, b, 3 * sizeof(int));
}

static inline int check_closed_open_edges(const check_closed *shell) {
    int count = 3 * shell->triangle_count, open = 0;
    int(*edges)[3] = (int(*)[3])malloc(sizeof(int[3]) * (size_t)(count + 1));
    for (int i = 0; i < count; i++) {
        int a = check_closed_key(shell, i), b = check_closed_key(shell, i - i % 3 + (i + 1) % 3);
        edges[i][0] = a < b ? a : b, edges[i][1] = a < b ? b : a, edges[i][2] = a < b ? 1 : -1;
        if (a == b) edges[i][2] = 0;
    }
    qsort(edges, (size_t)count, sizeof *edges, check_closed_compare);
    for (int i = 0, j; i < count; i = j) {
        int sum = 0;
        for (j = i; j < count && edges[j][0] == edges[i][0] && edges[j][1] == edges[i][1]; j++) sum += edges[j][2];
        open += abs(sum);
    }
    free(edges);
    return open;
}

/* piece[triangle_count]: components of triangles joined by keys. Returns how many there are. */
static inline int check_closed_pieces(const check_closed *shell, int *piece) {
    int *root = (int *)malloc(sizeof(int) * (size_t)(shell->vertex_count + 1)), changed = 1, count = 0;
    int *number = (int *)malloc(sizeof(int) * (size_t)(shell->vertex_count + 1));
    for (int v = 0; v < shell->vertex_count; v++) root[v] = v, number[v] = -1;
    while (changed) {
        changed = 0;
        for (int i = 0; i < 3 * shell->triangle_count; i++) {
            int a = check_closed_key(shell, i), b = check_closed_key(shell, i - i % 3 + (i + 1) % 3);
            while (root[a] != a) a = root[a] = root[root[a]];
            while (root[b] != b) b = root[b] = root[root[b]];
            if (a != b) root[a > b ? a : b] = a > b ? b : a, changed = 1;
        }
    }
    for (int t = 0; t < shell->triangle_count; t++) {
        int a = check_closed_key(shell, 3 * t);
        while (root[a] != a) a = root[a];
        if (number[a] < 0) number[a] = count++;
        piece[t] = number[a];
    }
    free(root);
    free(number);
    return count;
}

/* Of the triangles with mark[t] == value, or of all where mark is NULL. */
static inline double check_closed_volume(const check_closed *shell, const int *mark, int value) {
    double sum = 0;
    for (int t = 0; t < shell->triangle_count; t++) {
        dgfem_vec3 p[3];
        double a[3][3];
        if (mark && mark[t] != value) continue;
        for (int k = 0; k < 3; k++) {
            p[k] = shell->positions[shell->triangles[3 * t + k]];
            a[k][0] = (double)p[k].x, a[k][1] = (double)p[k].y, a[k][2] = (double)p[k].z;
        }
        sum += a[0][0] * (a[1][1] * a[2][2] - a[1][2] * a[2][1]) - a[0][1] * (a[1][0] * a[2][2] - a[1][2] * a[2][0]) +
               a[0][2] * (a[1][0] * a[2][1] - a[1][1] * a[2][0]);
    }
    return sum / 6;
}

static inline double check_closed_area(const check_closed *shell, const int *mark, int value) {
    double sum = 0;
    for (int t = 0; t < shell->triangle_count; t++) {
        dgfem_vec3 a, b, c;
        double u[3], v[3], n[3];
        if (mark && mark[t] != value) continue;
        a = shell->positions[shell->triangles[3 * t]], b = shell->positions[shell->triangles[3 * t + 1]];
        c = shell->positions[shell->triangles[3 * t + 2]];
        u[0] = (double)b.x - (double)a.x, u[1] = (double)b.y - (double)a.y, u[2] = (double)b.z - (double)a.z;
        v[0] = (double)c.x - (double)a.x, v[1] = (double)c.y - (double)a.y, v[2] = (double)c.z - (double)a.z;
        n[0] = u[1] * v[2] - u[2] * v[1], n[1] = u[2] * v[0] - u[0] * v[2], n[2] = u[0] * v[1] - u[1] * v[0];
        sum += sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]) / 2;
    }
    return sum;
}

#endif
