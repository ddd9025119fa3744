#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lattice.h"

/* Nodes: the corners of nx * ny * nz cubes, and behind them their centres. */
typedef struct lattice {
    const formats_surface *surface;
    int n[3], corners, nodes;
    double lower[3], size;
    double *x;         /* [3 * nodes] */
    signed char *side; /* [nodes] 1 inside, 0 on the surface, -1 outside */
    int *edges;        /* pairs of nodes on different sides, the lower first */
    double *at;        /* [edge_count] where they cross, from the first; negative: no longer */
    int edge_count, edge_capacity, failed;
    formats_tetrahedra *out;
    int *number; /* [nodes + edges] vertex of the result, or -1 */
    int vertex_capacity, tetrahedron_capacity;
} lattice;

static int corner_index(const lattice *l, int i, int j, int k) { return i + (l->n[0] + 1) * (j + (l->n[1] + 1) * k); }
static int centre_index(const lattice *l, int i, int j, int k) {
    return l->corners + i + l->n[0] * (j + l->n[1] * k);
}

/* ---- inside and outside ---- */

/* Twice the area of the triangle of a, b and p, seen from above; the same number, negated, for b and a. */
static double turn2(const double *a, const double *b, const double *p) {
    if (b[0] < a[0] || (b[0] == a[0] && b[1] < a[1])) return -turn2(b, a, p);
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
}

/* Whether p is left of the edge from a to b, as if it were displaced by (-e^2, e) with an infinitely small e: so a ray
   through an edge of two triangles meets one of them. */
static int is_left(const double *a, const double *b, const double *p) {
    int is_reversed = b[0] < a[0] || (b[0] == a[0] && b[1] < a[1]);
    double turn = turn2(a, b, p);
    return turn > 0 || (turn == 0 && !is_reversed);
}

/* Number of times that a ray upwards from a point crosses the surface, modulo 2. */
static int is_inside(const formats_surface *s, const double *p) {
    int crossings = 0;
    for (int t = 0; t < s->triangle_count; t++) {
        const double *a = s->vertices + 3 * s->triangles[3 * t], *b = s->vertices + 3 * s->triangles[3 * t + 1],
                     *c = s->vertices + 3 * s->triangles[3 * t + 2];
        int left = is_left(a, b, p);
        if (is_left(b, c, p) != left || is_left(c, a, p) != left) continue;
        double u = turn2(b, c, p), v = turn2(c, a, p), w = turn2(a, b, p);
        if (u + v + w != 0) crossings += (u * a[2] + v * b[2] + w * c[2]) / (u + v + w) > p[2];
    }
    return crossings & 1;
}

/* Where the segment from p to q meets the surface first, in [0, 1]; 1/2 where round-off hides it. */
static double crossing(const formats_surface *s, const double *p, const double *q) {
    double first = 2, d[3], e[3], f[3], g[3], n[3];
    for (int t = 0; t < s->triangle_count; t++) {
        const double *a = s->vertices + 3 * s->triangles[3 * t], *b = s->vertices + 3 * s->triangles[3 * t + 1],
                     *c = s->vertices + 3 * s->triangles[3 * t + 2];
        for (int k = 0; k < 3; k++) d[k] = q[k] - p[k], e[k] = b[k] - a[k], f[k] = c[k] - a[k], g[k] = p[k] - a[k];
        n[0] = e[1] * f[2] - e[2] * f[1], n[1] = e[2] * f[0] - e[0] * f[2], n[2] = e[0] * f[1] - e[1] * f[0];
        double det = -(n[0] * d[0] + n[1] * d[1] + n[2] * d[2]);
        double r = (n[0] * g[0] + n[1] * g[1] + n[2] * g[2]) / det;
        double m[3] = {g[1] * d[2] - g[2] * d[1], g[2] * d[0] - g[0] * d[2], g[0] * d[1] - g[1] * d[0]};
        double u = (f[0] * m[0] + f[1] * m[1] + f[2] * m[2]) / det;
        double v = -(e[0] * m[0] + e[1] * m[1] + e[2] * m[2]) / det;
        if (r >= 0 && r <= 1 && u >= -1e-9 && v >= -1e-9 && u + v <= 1 + 2e-9 && r < first) first = r;
    }
    return first <= 1 ? first : 0.5;
}

/* ---- the lattice ---- */

static int place_nodes(lattice *l, int cells) {
    const formats_surface *s = l->surface;
    double upper[3], longest = 0;
    for (int k = 0; k < 3; k++) l->lower[k] = INFINITY, upper[k] = -INFINITY;
    for (int i = 0; i < 3 * s->vertex_count; i++) {
        l->lower[i % 3] = fmin(l->lower[i % 3], s->vertices[i]);
        upper[i % 3] = fmax(upper[i % 3], s->vertices[i]);
    }
    for (int k = 0; k < 3; k++) longest = fmax(longest, upper[k] - l->lower[k]);
    l->size = longest / cells;
    for (int k = 0; k < 3; k++) {
        double middle = (upper[k] + l->lower[k]) / 2;
        l->n[k] = (int)ceil((upper[k] - l->lower[k]) / l->size - 1e-9) + 2;
        l->lower[k] = middle - (l->n[k] / 2.0 + 0.0137 * (k + 1)) * l->size; /* off planes of symmetry */
    }
    l->corners = (l->n[0] + 1) * (l->n[1] + 1) * (l->n[2] + 1);
    l->nodes = l->corners + l->n[0] * l->n[1] * l->n[2];
    l->x = (double *)malloc(3 * (size_t)l->nodes * sizeof(double));
    l->side = (signed char *)malloc((size_t)l->nodes);
    if (!l->x || !l->side) return 0;
    for (int centred = 0; centred < 2; centred++)
        for (int k = 0; k < l->n[2] + !centred; k++)
            for (int j = 0; j < l->n[1] + !centred; j++)
                for (int i = 0; i < l->n[0] + !centred; i++) {
                    int node = centred ? centre_index(l, i, j, k) : corner_index(l, i, j, k);
                    double *x = l->x + 3 * node, shift = centred / 2.0;
                    x[0] = l->lower[0] + l->size * (i + shift);
                    x[1] = l->lower[1] + l->size * (j + shift);
                    x[2] = l->lower[2] + l->size * (k + shift);
                    l->side[node] = (signed char)(is_inside(s, x) ? 1 : -1);
                }
    return 1;
}

/* Calls fn for the four tetrahedra around each edge between the centres of two neighbouring cubes. */
static void each_tetrahedron(lattice *l, void (*fn)(lattice *, const int nodes[4])) {
    static const int square[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    for (int axis = 0; axis < 3; axis++)
        for (int k = axis == 2; k < l->n[2]; k++)
            for (int j = axis == 1; j < l->n[1]; j++)
                for (int i = axis == 0; i < l->n[0]; i++)
                    for (int t = 0; t < 4; t++) {
                        int nodes[4], at[3];
                        nodes[0] = centre_index(l, i - (axis == 0), j - (axis == 1), k - (axis == 2));
                        nodes[1] = centre_index(l, i, j, k);
                        for (int c = 0; c < 2; c++) {
                            at[0] = i, at[1] = j, at[2] = k;
                            at[(axis + 1) % 3] += square[(t + c) % 4][0];
                            at[(axis + 2) % 3] += square[(t + c) % 4][1];
                            nodes[2 + c] = corner_index(l, at[0], at[1], at[2]);
                        }
                        fn(l, nodes);
                    }
}

static void collect_edges(lattice *l, const int nodes[4]) {
    for (int a = 0; a < 4; a++)
        for (int b = 0; b < 4; b++) {
            if (nodes[a] >= nodes[b] || l->side[nodes[a]] == l->side[nodes[b]]) continue;
            if (l->edge_count == l->edge_capacity) {
                int capacity = l->edge_capacity ? 2 * l->edge_capacity : 1024;
                int *grown = (int *)realloc(l->edges, 2 * (size_t)capacity * sizeof(int));
                if (!grown) {
                    l->failed = 1;
                    return;
                }
                l->edges = grown;
                l->edge_capacity = capacity;
            }
            l->edges[2 * l->edge_count] = nodes[a], l->edges[2 * l->edge_count + 1] = nodes[b];
            l->edge_count++;
        }
}

static int compare_pairs(const void *left, const void *right) {
    const int *a = (const int *)left, *b = (const int *)right;
    return a[0] != b[0] ? (a[0] > b[0]) - (a[0] < b[0]) : (a[1] > b[1]) - (a[1] < b[1]);
}

/* The edges that the surface crosses, once each, and where. */
static int cross_edges(lattice *l) {
    int kept = 0;
    each_tetrahedron(l, collect_edges);
    if (l->failed || !l->edge_count) return 0;
    qsort(l->edges, (size_t)l->edge_count, 2 * sizeof(int), compare_pairs);
    for (int i = 0; i < l->edge_count; i++) {
        if (i && compare_pairs(l->edges + 2 * i, l->edges + 2 * kept - 2) == 0) continue;
        l->edges[2 * kept] = l->edges[2 * i], l->edges[2 * kept + 1] = l->edges[2 * i + 1];
        kept++;
    }
    l->edge_count = kept;
    l->at = (double *)malloc((size_t)kept * sizeof(double));
    for (int i = 0; l->at && i < kept; i++)
        l->at[i] = crossing(l->surface, l->x + 3 * l->edges[2 * i], l->x + 3 * l->edges[2 * i + 1]);
    return l->at != NULL;
}

/* Nodes that the surface passes nearly move onto it, each to the nearest crossing of its edges. */
static int move_nodes(lattice *l) {
    double *least = (double *)malloc((size_t)l->nodes * sizeof(double));
    int *which = (int *)malloc((size_t)l->nodes * sizeof(int));
    int ok = least && which;
    for (int i = 0; ok && i < l->nodes; i++) least[i] = 1, which[i] = -1;
    for (int e = 0; ok && e < l->edge_count; e++)
        for (int end = 0; end < 2; end++) {
            int node = l->edges[2 * e + end], other = l->edges[2 * e + !end];
            int is_long = (node < l->corners) == (other < l->corners);
            double part = (end ? 1 - l->at[e] : l->at[e]) / (is_long ? 0.24999 : 0.41189);
            if (part < least[node]) least[node] = part, which[node] = e;
        }
    for (int i = 0; ok && i < l->nodes; i++) {
        if (which[i] < 0) continue;
        const int *edge = l->edges + 2 * which[i];
        if (!l->side[edge[0]] || !l->side[edge[1]]) continue; /* its crossing is gone: the other end has moved there */
        for (int k = 0; k < 3; k++)
            l->x[3 * i + k] = (1 - l->at[which[i]]) * l->x[3 * edge[0] + k] + l->at[which[i]] * l->x[3 * edge[1] + k];
        l->side[i] = 0;
    }
    free(least);
    free(which);
    return ok;
}

/* ---- what is inside ---- */

static int result_vertex(lattice *l, int item, const double *x) {
    formats_tetrahedra *out = l->out;
    if (l->number[item] >= 0) return l->number[item];
    if (out->vertex_count == l->vertex_capacity) {
        int capacity = l->vertex_capacity ? 2 * l->vertex_capacity : 1024;
        double *grown = (double *)realloc(out->vertices, 3 * (size_t)capacity * sizeof(double));
        if (!grown) {
            l->failed = 1;
            return 0;
        }
        out->vertices = grown;
        l->vertex_capacity = capacity;
    }
    memcpy(out->vertices + 3 * out->vertex_count, x, 3 * sizeof(double));
    return l->number[item] = out->vertex_count++;
}

/* The vertex where the edge between two nodes on different sides leaves the surface. */
static int crossing_vertex(lattice *l, int a, int b) {
    int key[2] = {a < b ? a : b, a < b ? b : a};
    int e = (int)((int *)bsearch(key, l->edges, (size_t)l->edge_count, 2 * sizeof(int), compare_pairs) - l->edges) / 2;
    double x[3];
    for (int k = 0; k < 3; k++) x[k] = (1 - l->at[e]) * l->x[3 * key[0] + k] + l->at[e] * l->x[3 * key[1] + k];
    return result_vertex(l, l->nodes + e, x);
}

static void add_tetrahedron(lattice *l, int a, int b, int c, int d) {
    formats_tetrahedra *out = l->out;
    double u[3], v[3], w[3];
    if (out->tetrahedron_count == l->tetrahedron_capacity) {
        int capacity = l->tetrahedron_capacity ? 2 * l->tetrahedron_capacity : 1024;
        int *grown = (int *)realloc(out->tetrahedra, 4 * (size_t)capacity * sizeof(int));
        if (!grown) {
            l->failed = 1;
            return;
        }
        out->tetrahedra = grown;
        l->tetrahedron_capacity = capacity;
    }
    const double *x = out->vertices;
    for (int k = 0; k < 3; k++)
        u[k] = x[3 * b + k] - x[3 * a + k], v[k] = x[3 * c + k] - x[3 * a + k], w[k] = x[3 * d + k] - x[3 * a + k];
    double size = u[0] * (v[1] * w[2] - v[2] * w[1]) + u[1] * (v[2] * w[0] - v[0] * w[2]) +
                  u[2] * (v[0] * w[1] - v[1] * w[0]);
    int *t = out->tetrahedra + 4 * out->tetrahedron_count;
    if (!(fabs(size) > 1e-9 * l->size * l->size * l->size)) return;
    out->tetrahedron_count++;
    t[0] = a, t[1] = b, t[2] = size > 0 ? c : d, t[3] = size > 0 ? d : c;
}

/* Tetrahedra over the triangles of a face from `top`; a quadrilateral is divided at its lowest vertex, whichever side
   it is seen from. */
static void add_face(lattice *l, int top, const int *face, int count) {
    int low = 0;
    for (int i = 0; i < count; i++) {
        if (face[i] == top) return;
        if (face[i] < face[low]) low = i;
    }
    for (int i = 1; i + 1 < count; i++)
        add_tetrahedron(l, top, face[low], face[(low + i) % count], face[(low + i + 1) % count]);
}

/* The part of a tetrahedron that is inside, divided from its lowest vertex. */
static void add_inside(lattice *l, const int nodes[4]) {
    int in[4], out[4], ins = 0, outs = 0, faces[5][4], counts[5], face_count = 0, top = -1;
    for (int i = 0; i < 4; i++) {
        if (l->side[nodes[i]] > 0) in[ins++] = nodes[i];
        if (l->side[nodes[i]] < 0) out[outs++] = nodes[i];
    }
    if (!ins || l->failed) return;
    for (int skip = 0; skip < 4; skip++) {
        int *face = faces[face_count], count = 0;
        for (int i = 0; i < 3; i++) {
            int a = nodes[(skip + 1 + i) % 4], b = nodes[(skip + 1 + (i + 1) % 3) % 4];
            if (l->side[a] >= 0) face[count++] = result_vertex(l, a, l->x + 3 * a);
            if (l->side[a] * l->side[b] < 0) face[count++] = crossing_vertex(l, a, b);
        }
        counts[face_count] = count;
        face_count += count >= 3;
    }
    int *cap = faces[face_count], cap_count = 0; /* cyclic: only two inside and two outside make four corners */
    for (int i = 0; i < 4; i++)
        if (outs && !l->side[nodes[i]]) cap[cap_count++] = result_vertex(l, nodes[i], l->x + 3 * nodes[i]);
    for (int i = 0; i < ins; i++)
        for (int o = 0; o < outs; o++) cap[cap_count++] = crossing_vertex(l, in[i], out[i % 2 ? outs - 1 - o : o]);
    counts[face_count] = cap_count;
    face_count += cap_count >= 3;
    for (int f = 0; f < face_count; f++)
        for (int i = 0; i < counts[f]; i++)
            if (top < 0 || faces[f][i] < top) top = faces[f][i];
    for (int f = 0; f < face_count && !l->failed; f++) add_face(l, top, faces[f], counts[f]);
}

/* ---- the largest part ---- */

typedef struct side_of {
    int nodes[3], tetrahedron;
} side_of;

static int compare_sides(const void *left, const void *right) {
    const side_of *a = (const side_of *)left, *b = (const side_of *)right;
    for (int k = 0; k < 3; k++)
        if (a->nodes[k] != b->nodes[k]) return a->nodes[k] < b->nodes[k] ? -1 : 1;
    return 0;
}

static int root_of(int *parent, int i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

static side_of side_opposite(const int *t, int tetrahedron, int skip) {
    side_of s;
    for (int k = 0; k < 3; k++) s.nodes[k] = t[(skip + 1 + k) % 4];
    for (int pass = 0; pass < 2; pass++)
        for (int k = 0; k < 2; k++)
            if (s.nodes[k] > s.nodes[k + 1]) {
                int swap = s.nodes[k];
                s.nodes[k] = s.nodes[k + 1], s.nodes[k + 1] = swap;
            }
    s.tetrahedron = tetrahedron;
    return s;
}

/* Keeps the part of most tetrahedra that hang together by faces, and its vertices. */
static int keep_largest(formats_tetrahedra *m) {
    int n = m->tetrahedron_count, best = 0, kept = 0, vertices = 0;
    side_of *sides = (side_of *)malloc(4 * (size_t)n * sizeof *sides);
    int *parent = (int *)malloc(2 * (size_t)n * sizeof(int)), *size = parent + n;
    int *number = (int *)malloc((size_t)m->vertex_count * sizeof(int));
    int ok = sides && parent && number;
    for (int t = 0; ok && t < n; t++) {
        parent[t] = t, size[t] = 0;
        for (int k = 0; k < 4; k++) sides[4 * t + k] = side_opposite(m->tetrahedra + 4 * t, t, k);
    }
    if (ok) qsort(sides, 4 * (size_t)n, sizeof *sides, compare_sides);
    for (int i = 1; ok && i < 4 * n; i++)
        if (compare_sides(&sides[i - 1], &sides[i]) == 0)
            parent[root_of(parent, sides[i].tetrahedron)] = root_of(parent, sides[i - 1].tetrahedron);
    for (int t = 0; ok && t < n; t++) {
        int root = root_of(parent, t);
        if (++size[root] > size[best]) best = root;
    }
    for (int v = 0; ok && v < m->vertex_count; v++) number[v] = -1;
    for (int t = 0; ok && t < n; t++) {
        if (root_of(parent, t) != best) continue;
        for (int k = 0; k < 4; k++) number[m->tetrahedra[4 * kept + k] = m->tetrahedra[4 * t + k]] = 0;
        kept++;
    }
    for (int v = 0; ok && v < m->vertex_count; v++) {
        if (number[v] < 0) continue;
        memmove(m->vertices + 3 * vertices, m->vertices + 3 * v, 3 * sizeof(double));
        number[v] = vertices++;
    }
    for (int i = 0; ok && i < 4 * kept; i++) m->tetrahedra[i] = number[m->tetrahedra[i]];
    if (ok) m->vertex_count = vertices, m->tetrahedron_count = kept;
    free(sides);
    free(parent);
    free(number);
    return ok;
}

int lattice_fill(const formats_surface *surface, int cells, formats_tetrahedra *out) {
    lattice l;
    memset(out, 0, sizeof *out);
    memset(&l, 0, sizeof l);
    l.surface = surface;
    l.out = out;
    int ok = cells > 0 && place_nodes(&l, cells) && cross_edges(&l) && move_nodes(&l);
    if (ok) l.number = (int *)malloc((size_t)(l.nodes + l.edge_count) * sizeof(int));
    ok = ok && l.number;
    for (int i = 0; ok && i < l.nodes + l.edge_count; i++) l.number[i] = -1;
    if (ok) each_tetrahedron(&l, add_inside);
    ok = ok && !l.failed && out->tetrahedron_count && keep_largest(out);
    free(l.x);
    free(l.side);
    free(l.edges);
    free(l.at);
    free(l.number);
    if (!ok) formats_free_tetrahedra(out);
    return ok;
}
