/* Meshes of shells for examples and tests: patches of quadrilaterals or triangles with middle nodes on a mapped
   surface. */
#ifndef SHELL_GRID_H
#define SHELL_GRID_H

#include <stdlib.h>
#include <string.h>

#include "dgfem_shell.h"

/* A point of the surface, 0 <= u, v <= 1. The normal is that of d/du x d/dv. */
typedef dgfem_vec3 (*shell_grid_map)(void *user, double u, double v);

typedef struct shell_grid {
    dgfem_vec3 *nodes;
    int *elements; /* 8 or 6 nodes each */
    int node_count, element_count, triangles;
} shell_grid;

static inline void shell_grid_free(shell_grid *grid) {
    free(grid->nodes);
    free(grid->elements);
    memset(grid, 0, sizeof *grid);
}

/* The node at this place: one that is there already within `weld`, or a new one. */
static inline int shell_grid_node(shell_grid *grid, dgfem_vec3 x, double weld) {
    for (int i = 0; weld > 0 && i < grid->node_count; i++) {
        double dx = (double)(grid->nodes[i].x - x.x), dy = (double)(grid->nodes[i].y - x.y);
        double dz = (double)(grid->nodes[i].z - x.z);
        if (dx * dx + dy * dy + dz * dz < weld * weld) return i;
    }
    grid->nodes[grid->node_count] = x;
    return grid->node_count++;
}

static inline void shell_grid_element(shell_grid *grid, const int *at, const int *list, int stride, int count) {
    int *out = grid->elements + count * grid->element_count++;
    for (int k = 0; k < count; k++) out[k] = at[list[2 * k] + stride * list[2 * k + 1]];
}

/* Adds a patch of nu x nv cells, each one quadrilateral or two triangles. weld > 0 joins nodes closer than that, within
   the patch and with earlier ones. 0 when out of memory. */
static inline int shell_grid_add(shell_grid *grid, int nu, int nv, int triangles, double weld, shell_grid_map map,
                                 void *user) {
    static const int quad[] = {0, 0, 2, 0, 2, 2, 0, 2, 1, 0, 2, 1, 1, 2, 0, 1};
    static const int lower[] = {0, 0, 2, 0, 2, 2, 1, 0, 2, 1, 1, 1}, upper[] = {0, 0, 2, 2, 0, 2, 1, 1, 1, 2, 0, 1};
    int stride = 2 * nu + 1, rows = 2 * nv + 1, per = triangles ? 6 : 8, cells = nu * nv * (triangles ? 2 : 1);
    int *at = (int *)malloc((size_t)(stride * rows) * sizeof(int));
    dgfem_vec3 *nodes = (dgfem_vec3 *)realloc(grid->nodes, (size_t)(grid->node_count + stride * rows) * sizeof *nodes);
    if (nodes) grid->nodes = nodes;
    int *elements = (int *)realloc(grid->elements, (size_t)(per * (grid->element_count + cells)) * sizeof(int));
    if (elements) grid->elements = elements;
    if (!at || !nodes || !elements) return free(at), 0;
    grid->triangles = triangles;
    for (int j = 0; j < rows; j++)
        for (int i = 0; i < stride; i++)
            if (triangles || !(i % 2 && j % 2))
                at[i + stride * j] =
                    shell_grid_node(grid, map(user, (double)i / (stride - 1), (double)j / (rows - 1)), weld);
    for (int j = 0; j < nv; j++)
        for (int i = 0; i < nu; i++) {
            const int *corner = at + 2 * i + 2 * stride * j;
            if (triangles) {
                shell_grid_element(grid, corner, lower, stride, 6);
                shell_grid_element(grid, corner, upper, stride, 6);
            } else {
                shell_grid_element(grid, corner, quad, stride, 8);
            }
        }
    free(at);
    return 1;
}

/* Points the descriptor at the grid, which must outlive dgfem_shell_create. */
static inline void shell_grid_describe(const shell_grid *grid, dgfem_shell_desc *desc) {
    desc->vertices = dgfem_points_in_vec3(grid->nodes, grid->node_count);
    desc->nodes_per_quad = 8;
    desc->nodes_per_triangle = 6;
    if (grid->triangles) desc->triangles = grid->elements, desc->triangle_count = grid->element_count;
    else desc->quads = grid->elements, desc->quad_count = grid->element_count;
}

/* The node nearest to a place at rest. */
static inline int shell_grid_nearest(const dgfem_shell *shell, double x, double y, double z) {
    int best = 0;
    double least = 1e300;
    for (int i = 0; i < shell->node_count; i++) {
        double dx = (double)shell->rest[i].x - x, dy = (double)shell->rest[i].y - y, dz = (double)shell->rest[i].z - z;
        double square = dx * dx + dy * dy + dz * dz;
        if (square < least) least = square, best = i;
    }
    return best;
}

#endif
