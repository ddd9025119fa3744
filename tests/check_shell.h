/* Shared by the tests of shells: small meshes, forces as dense vectors, pivoted rank. Include it after check.h. */
#ifndef CHECK_SHELL_H
#define CHECK_SHELL_H

#include "shell_grid.h"

static inline dgfem_vec3 at3(double x, double y, double z) {
    dgfem_vec3 v;
    v.x = (dgfem_real)x, v.y = (dgfem_real)y, v.z = (dgfem_real)z;
    return v;
}

static inline dgfem_vec3 map_flat(void *user, double u, double v) {
    (void)user;
    return at3(u, v, 0);
}

/* Doubly curved, with skewed parameters. */
static inline dgfem_vec3 map_curved(void *user, double u, double v) {
    (void)user;
    return at3(3 * u + 0.2 * v * v, 2 * v + 0.1 * u * v, 0.5 * sin(2 * u) + 0.3 * v * v);
}

/* A right angle along u = 0.5: an even number of cells across has its edges there. */
static inline dgfem_vec3 map_fold(void *user, double u, double v) {
    (void)user;
    return u < 0.5 ? at3(2 * u, v, 0) : at3(1, v, 2 * u - 1);
}

static inline dgfem_vec3 map_tube(void *user, double u, double v) {
    (void)user;
    return at3(cos(6.283185307179586 * u), sin(6.283185307179586 * u), 2 * v);
}

/* Soft, thick, weightless: conditions are mild in both precisions. */
static inline dgfem_shell_desc shell_desc(void) {
    dgfem_shell_desc desc = dgfem_default_shell_desc();
    desc.material.young = 1000;
    desc.material.poisson = (dgfem_real)0.3;
    desc.material.density = 10;
    desc.thickness = (dgfem_real)0.1;
    desc.gravity = at3(0, 0, 0);
    return desc;
}

static inline dgfem_shell *shell_make(const dgfem_shell_desc *desc, int nu, int nv, int triangles, shell_grid_map map) {
    shell_grid grid;
    dgfem_shell_desc full = *desc;
    dgfem_shell *shell;
    memset(&grid, 0, sizeof grid);
    assert_true(shell_grid_add(&grid, nu, nv, triangles, 1e-4, map, NULL));
    shell_grid_describe(&grid, &full);
    check_status(dgfem_shell_create(&full, &shell), DGFEM_OK);
    shell_grid_free(&grid);
    return shell;
}

/* Unit square of two quadrilaterals and four triangles, corners only:  3 -- 4 -- 5     8
                                                                        |    |    | \ / |    (the right half in
                                                                        0 -- 1 -- 2 - 7      triangles about 6)  */
static inline dgfem_shell *shell_make_mixed(const dgfem_shell_desc *desc, double height) {
    static const int quads[] = {0, 1, 4, 3, 1, 2, 5, 4}, triangles[] = {2, 7, 6, 7, 8, 6, 8, 5, 6, 5, 2, 6};
    double points[27] = {0, 0,    0, 0.3, 0,   0,    0.6, 0, 0, 0, 1, 0, 0.25, 1,
                         0, 0.65, 1, 0,   0.8, 0.45, 0,   1, 0, 0, 1, 1, 0};
    dgfem_shell_desc full = *desc;
    dgfem_shell *shell;
    for (int i = 0; i < 9; i++) points[3 * i + 2] = height * sin(3 * points[3 * i]) * (1 + points[3 * i + 1]);
    full.vertices = dgfem_points_in_double(points, 9);
    full.quads = quads, full.quad_count = 2;
    full.triangles = triangles, full.triangle_count = 4;
    check_status(dgfem_shell_create(&full, &shell), DGFEM_OK);
    return shell;
}

/* Symmetric dense copy of the stiffness at the current state. */
static inline double *shell_dense(dgfem_shell *shell, int tangent) {
    const dgfem_matrix *matrix;
    check_status(dgfem_shell_stiffness(shell, tangent, &matrix), DGFEM_OK);
    size_t n = (size_t)matrix->size;
    double *dense = (double *)calloc(n * n, sizeof *dense);
    for (int r = 0; r < matrix->block_count; r++)
        for (int k = matrix->row_start[r]; k < matrix->row_start[r + 1]; k++)
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++) {
                    double value = (double)matrix->values[matrix->value_start[k] + (size_t)(3 * i + j)];
                    dense[(size_t)(3 * r + i) * n + (size_t)(3 * matrix->column[k] + j)] = value;
                    dense[(size_t)(3 * matrix->column[k] + j) * n + (size_t)(3 * r + i)] = value;
                }
    return dense;
}

/* Zero pivots of a positive semidefinite matrix (destroyed), by Cholesky with the largest diagonal first; -1 where one
   is negative by more than the tolerance. */
static inline int shell_zero_modes(double *a, int size, double tolerance) {
    size_t n = (size_t)size;
    double largest = 0;
    for (size_t step = 0; step < n; step++) {
        size_t pivot = step;
        for (size_t i = step; i < n; i++)
            if (a[i * n + i] > a[pivot * n + pivot]) pivot = i;
        if (step == 0) largest = a[pivot * n + pivot];
        for (size_t i = step; i < n; i++)
            if (a[i * n + i] < -tolerance * largest) return -1;
        double d = a[pivot * n + pivot];
        if (!(d > tolerance * largest)) return (int)(n - step);
        for (size_t j = 0; j < n; j++) {
            double swap = a[step * n + j];
            a[step * n + j] = a[pivot * n + j], a[pivot * n + j] = swap;
        }
        for (size_t i = 0; i < n; i++) {
            double swap = a[i * n + step];
            a[i * n + step] = a[i * n + pivot], a[i * n + pivot] = swap;
        }
        for (size_t i = step + 1; i < n; i++) {
            double factor = a[i * n + step] / d;
            for (size_t j = step + 1; j < n; j++) a[i * n + j] -= factor * a[step * n + j];
        }
    }
    return 0;
}

static inline double shell_largest(const dgfem_vec3 *v, int count) {
    double largest = 0;
    for (int i = 0; i < count; i++) {
        largest = fmax(largest, fabs((double)v[i].x));
        largest = fmax(largest, fabs((double)v[i].y));
        largest = fmax(largest, fabs((double)v[i].z));
    }
    return largest;
}

/* All boundary nodes, as a list to be freed. */
static inline int *shell_boundary_nodes(const dgfem_shell *shell, int *count) {
    char *mark = (char *)calloc((size_t)shell->node_count, 1);
    int *nodes = (int *)malloc((size_t)shell->node_count * sizeof(int));
    *count = 0;
    for (int i = 0; i < shell->edge_count; i++)
        for (int a = 0; a < 3 && shell->edges[i].element[1] == DGFEM_NONE; a++) mark[shell->edges[i].node[a]] = 1;
    for (int i = 0; i < shell->node_count; i++)
        if (mark[i]) nodes[(*count)++] = i;
    free(mark);
    return nodes;
}

static inline dgfem_plane plane_of(double x, double y, double z, double offset) {
    dgfem_plane plane;
    plane.normal = at3(x, y, z), plane.offset = (dgfem_real)offset;
    return plane;
}

/* Boundary edges on a plane, at most 256. */
static inline int shell_edges(const dgfem_shell *shell, dgfem_plane plane, int *edges) {
    int count = dgfem_shell_edges_on_plane(shell, plane, (dgfem_real)1e-4, edges, 256);
    assert_true(count > 0 && count <= 256);
    return count;
}

#endif
