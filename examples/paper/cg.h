/* Continuous finite elements of linear elasticity, for comparison: linear tetrahedra and trilinear boxes, with nodes on
   planes held at zero. Three unknowns per free node, in the library's block matrix, solved by its Cholesky
   factorization. */
#ifndef CG_H
#define CG_H

#include "paper.h"

typedef struct cg {
    int node_count, corners, element_count; /* corners of an element: 4 (tetrahedra) or 8 (boxes: x fastest) */
    dgfem_vec3 *nodes;
    int *elements;
    char *held;        /* [node_count] */
    int *block;        /* [node_count] block of the matrix, or DGFEM_NONE */
    double *stiffness; /* [element_count] (3 * corners)^2 */
    dgfem_matrix *matrix;
    double *x; /* 3 per block */
    double seconds_integrate, seconds_analyse, seconds_assemble, seconds_factor, seconds_solve;
} cg;

static inline cg cg_create(int node_count, int corners, int element_count) {
    cg c;
    memset(&c, 0, sizeof c);
    c.node_count = node_count, c.corners = corners, c.element_count = element_count;
    c.nodes = (dgfem_vec3 *)need_memory((size_t)node_count, sizeof *c.nodes);
    c.elements = (int *)need_memory((size_t)corners * (size_t)element_count, sizeof *c.elements);
    c.held = (char *)need_memory((size_t)node_count, 1);
    c.block = (int *)need_memory((size_t)node_count, sizeof *c.block);
    return c;
}

static inline void cg_free(cg *c) {
    free(c->nodes);
    free(c->elements);
    free(c->held);
    free(c->block);
    free(c->stiffness);
    free(c->x);
    dgfem_matrix_destroy(c->matrix);
}

static inline cg cg_tetrahedra(const kuhn *k) {
    cg c = cg_create(k->vertex_count, 4, k->tetrahedron_count);
    memcpy(c.nodes, k->vertices, (size_t)k->vertex_count * sizeof *c.nodes);
    memcpy(c.elements, k->tetrahedra, 4 * (size_t)k->tetrahedron_count * sizeof *c.elements);
    return c;
}

static inline cg cg_boxes(dgfem_vec3 lower, dgfem_vec3 upper, int nx, int ny, int nz) {
    kuhn k = kuhn_create(lower, upper, nx, ny, nz);
    cg c = cg_create(k.vertex_count, 8, nx * ny * nz);
    memcpy(c.nodes, k.vertices, (size_t)k.vertex_count * sizeof *c.nodes);
    kuhn_free(&k);
    for (int e = 0; e < c.element_count; e++)
        for (int v = 0; v < 8; v++) {
            int i = e % nx + v % 2, j = e / nx % ny + v / 2 % 2, l = e / (nx * ny) + v / 4;
            c.elements[8 * e + v] = i + (nx + 1) * (j + (ny + 1) * l);
        }
    return c;
}

static inline int cg_is_on(const cg *c, int node, dgfem_plane p) {
    dgfem_vec3 x = c->nodes[node];
    return fabs(p.normal.x * x.x + p.normal.y * x.y + p.normal.z * x.z - p.offset) < 1e-9;
}

static inline void cg_hold_plane(cg *c, dgfem_plane p) {
    for (int v = 0; v < c->node_count; v++)
        if (cg_is_on(c, v, p)) c->held[v] = 1;
}

/* Gradients of the element's functions at Gauss point q; returns the point's weight. */
static inline double cg_gradients(const cg *c, int element, int q, double (*gradient)[3]) {
    const int *v = c->elements + c->corners * element;
    dgfem_vec3 a = c->nodes[v[0]];
    if (c->corners == 8) {
        const double g[2] = {0.5 - 0.28867513459481287, 0.5 + 0.28867513459481287};
        double x = g[q % 2], y = g[q / 2 % 2], z = g[q / 4];
        double hx = c->nodes[v[1]].x - a.x, hy = c->nodes[v[2]].y - a.y, hz = c->nodes[v[4]].z - a.z;
        for (int i = 0; i < 8; i++) {
            double px = i % 2 ? x : 1 - x, py = i / 2 % 2 ? y : 1 - y, pz = i / 4 ? z : 1 - z;
            gradient[i][0] = (i % 2 ? 1 : -1) / hx * py * pz;
            gradient[i][1] = (i / 2 % 2 ? 1 : -1) / hy * px * pz;
            gradient[i][2] = (i / 4 ? 1 : -1) / hz * px * py;
        }
        return hx * hy * hz / 8;
    }
    double e[3][3];
    for (int i = 0; i < 3; i++) {
        dgfem_vec3 b = c->nodes[v[i + 1]];
        e[i][0] = b.x - a.x, e[i][1] = b.y - a.y, e[i][2] = b.z - a.z;
    }
    double volume = 0; /* six times */
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        for (int d = 0; d < 3; d++)
            gradient[i + 1][d] = e[j][(d + 1) % 3] * e[k][(d + 2) % 3] - e[j][(d + 2) % 3] * e[k][(d + 1) % 3];
    }
    for (int d = 0; d < 3; d++) volume += e[0][d] * gradient[1][d];
    for (int d = 0; d < 3; d++) {
        for (int i = 1; i < 4; i++) gradient[i][d] /= volume;
        gradient[0][d] = -gradient[1][d] - gradient[2][d] - gradient[3][d];
    }
    return volume / 6;
}

static inline void cg_integrate(cg *c, double young, double poisson) {
    double mu = young / (2 * (1 + poisson)), lambda = young * poisson / ((1 + poisson) * (1 - 2 * poisson));
    int n = c->corners, size = 3 * n;
    double start = cpu_seconds(NULL), g[8][3];
    c->stiffness = need_reals((size_t)c->element_count * (size_t)(size * size));
    for (int e = 0; e < c->element_count; e++) {
        double *k = c->stiffness + (size_t)e * (size_t)(size * size);
        for (int q = 0; q < (n == 8 ? 8 : 1); q++) {
            double weight = cg_gradients(c, e, q, g);
            for (int i = 0; i < n; i++)
                for (int j = 0; j < n; j++) {
                    double dot = g[i][0] * g[j][0] + g[i][1] * g[j][1] + g[i][2] * g[j][2];
                    for (int a = 0; a < 3; a++)
                        for (int b = 0; b < 3; b++)
                            k[(3 * i + a) * size + 3 * j + b] +=
                                weight *
                                (lambda * g[i][a] * g[j][b] + mu * g[i][b] * g[j][a] + (a == b ? mu * dot : 0));
                }
        }
    }
    c->seconds_integrate = cpu_seconds(NULL) - start;
}

static inline void cg_create_matrix(cg *c) {
    dgfem_matrix_desc desc = dgfem_default_matrix_desc();
    int n = c->corners, blocks = 0, pair = 0;
    int *sizes = (int *)need_memory((size_t)c->node_count, sizeof *sizes);
    int *pairs = (int *)need_memory((size_t)(n * n) * (size_t)c->element_count, sizeof *pairs);
    dgfem_vec3 *centres = (dgfem_vec3 *)need_memory((size_t)c->node_count, sizeof *centres);
    for (int v = 0; v < c->node_count; v++) {
        c->block[v] = c->held[v] ? DGFEM_NONE : blocks;
        if (c->held[v]) continue;
        sizes[blocks] = 3;
        centres[blocks++] = c->nodes[v];
    }
    for (int e = 0; e < c->element_count; e++)
        for (int i = 0; i < n; i++)
            for (int j = 0; j < i; j++) {
                int r = c->block[c->elements[n * e + i]], s = c->block[c->elements[n * e + j]];
                if (r != DGFEM_NONE && s != DGFEM_NONE) pairs[pair++] = r, pairs[pair++] = s;
            }
    desc.block_count = blocks, desc.block_sizes = sizes;
    desc.pairs = pairs, desc.pair_count = pair / 2;
    desc.centres = centres;
    desc.hooks = paper_hooks();
    need(dgfem_matrix_create(&desc, &c->matrix), "matrix");
    free(sizes);
    free(pairs);
    free(centres);
}

/* Assembles K x = F for a force density that is the same everywhere; F is to be freed. */
static inline double *cg_assemble(cg *c, dgfem_vec3 density) {
    int n = c->corners, size = 3 * n;
    double start, *rhs, g[8][3];
    cg_create_matrix(c);
    start = cpu_seconds(NULL);
    rhs = need_reals((size_t)c->matrix->size);
    for (int e = 0; e < c->element_count; e++) {
        const double *k = c->stiffness + (size_t)e * (size_t)(size * size);
        double share = cg_gradients(c, e, 0, g) * (n == 8 ? 1 : 0.25); /* volume / corners */
        for (int i = 0; i < n; i++) {
            int row = c->block[c->elements[n * e + i]];
            if (row == DGFEM_NONE) continue;
            rhs[3 * row] += share * density.x, rhs[3 * row + 1] += share * density.y,
                rhs[3 * row + 2] += share * density.z;
            for (int j = 0; j < n; j++) {
                int column = c->block[c->elements[n * e + j]];
                if (column == DGFEM_NONE || column > row) continue;
                double *out = dgfem_matrix_block(c->matrix, row, column);
                for (int a = 0; a < 3; a++)
                    for (int b = 0; b < 3; b++) out[3 * a + b] += k[(3 * i + a) * size + 3 * j + b];
            }
        }
    }
    c->seconds_assemble = cpu_seconds(NULL) - start;
    return rhs;
}

static inline void cg_solve(cg *c, double young, double poisson, dgfem_vec3 density) {
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_cholesky *cholesky;
    double *rhs, start;
    cg_integrate(c, young, poisson);
    rhs = cg_assemble(c, density);
    c->x = need_reals((size_t)c->matrix->size);
    start = cpu_seconds(NULL);
    need(dgfem_cholesky_create(c->matrix, &desc, &cholesky), "Cholesky");
    c->seconds_analyse = cpu_seconds(NULL) - start;
    start = cpu_seconds(NULL);
    need(dgfem_cholesky_factor(cholesky, c->matrix, NULL), "Cholesky");
    c->seconds_factor = cpu_seconds(NULL) - start;
    need(dgfem_cholesky_solve(cholesky, rhs, c->x), "Cholesky");
    c->seconds_solve = cpu_seconds(NULL) - start - c->seconds_factor;
    dgfem_cholesky_destroy(cholesky);
    free(rhs);
}

static inline dgfem_vec3 cg_displacement(const cg *c, int node) {
    const double *x = c->x + 3 * c->block[node];
    return c->block[node] == DGFEM_NONE ? vec3(0, 0, 0) : vec3(x[0], x[1], x[2]);
}

/* Mean displacement over the part of the boundary on a plane, each element's face with its area. */
static inline dgfem_vec3 cg_mean_on(const cg *c, dgfem_plane p) {
    double area = 0;
    dgfem_vec3 sum = vec3(0, 0, 0);
    int face_corners = c->corners == 8 ? 4 : 3;
    for (int e = 0; e < c->element_count; e++) {
        int on[8], count = 0;
        for (int i = 0; i < c->corners; i++)
            if (cg_is_on(c, c->elements[c->corners * e + i], p)) on[count++] = c->elements[c->corners * e + i];
        if (count != face_corners) continue;
        dgfem_vec3 a = c->nodes[on[0]], b = c->nodes[on[1]], d = c->nodes[on[2]];
        dgfem_vec3 u = vec3(b.x - a.x, b.y - a.y, b.z - a.z), v = vec3(d.x - a.x, d.y - a.y, d.z - a.z);
        double x = u.y * v.z - u.z * v.y, y = u.z * v.x - u.x * v.z, z = u.x * v.y - u.y * v.x;
        double s = sqrt(x * x + y * y + z * z) * (c->corners == 8 ? 1 : 0.5);
        for (int i = 0; i < count; i++) {
            dgfem_vec3 w = cg_displacement(c, on[i]);
            sum = vec3(sum.x + s / count * w.x, sum.y + s / count * w.y, sum.z + s / count * w.z);
        }
        area += s;
    }
    return vec3(sum.x / area, sum.y / area, sum.z / area);
}

#endif
