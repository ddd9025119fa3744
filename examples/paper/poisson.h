/* The Poisson problem -lap u = f in the unit square, u = g on its boundary, on n x n squares: discontinuous Galerkin
   with polynomials of degree 1 or 2 (BZ, IP), eqs. (12) and (14) of the paper, and continuous bilinear elements. It
   uses the library's block matrix and Cholesky factorization; integrals are by Gauss points, as f and g are any
   functions.

   Penalties are eta / h on all edges. On the boundary an edge has only one side: v and u are one-sided there, the
   average is the value, and g enters the right-hand side, int (eta/h g v - g dv/dn). */
#ifndef POISSON_H
#define POISSON_H

#include "paper.h"

typedef double (*plane_fn)(double x, double y);

typedef struct poisson {
    int n;          /* cells along each side */
    int degree;     /* 1 or 2 */
    int consistent; /* 1: IP, 0: BZ */
    double eta;
    double boundary; /* factor of the penalty on the boundary */
    plane_fn f, g, exact;
    dgfem_matrix *matrix;
    double *rhs, *x;
} poisson;

enum { POISSON_GAUSS = 6, POISSON_BASIS = 6 };

static inline int poisson_basis_count(const poisson *p) { return p->degree == 1 ? 3 : 6; }

/* Monomials of the cell's coordinates a, b in [-1/2, 1/2], and their derivatives with respect to x and y. */
static inline void poisson_basis(const poisson *p, double a, double b, double *v, double (*d)[2]) {
    double n = (double)p->n;
    const double value[6] = {1, a, b, a * a, a * b, b * b};
    const double dx[6] = {0, n, 0, 2 * a * n, b * n, 0}, dy[6] = {0, 0, n, 0, a * n, 2 * b * n};
    for (int i = 0; i < poisson_basis_count(p); i++) v[i] = value[i], d[i][0] = dx[i], d[i][1] = dy[i];
}

static inline void poisson_create_matrix(poisson *p) {
    int n = p->n, cells = n * n, pair = 0;
    dgfem_matrix_desc desc = dgfem_default_matrix_desc();
    int *sizes = (int *)need_memory((size_t)cells, sizeof *sizes);
    int *pairs = (int *)need_memory(4 * (size_t)cells, sizeof *pairs);
    dgfem_vec3 *centres = (dgfem_vec3 *)need_memory((size_t)cells, sizeof *centres);
    for (int c = 0; c < cells; c++) {
        sizes[c] = poisson_basis_count(p);
        centres[c] = vec3(c % n + 0.5, c / n + 0.5, 0);
        if (c % n + 1 < n) pairs[pair++] = c, pairs[pair++] = c + 1;
        if (c + n < cells) pairs[pair++] = c, pairs[pair++] = c + n;
    }
    desc.block_count = cells, desc.block_sizes = sizes;
    desc.pairs = pairs, desc.pair_count = pair / 2;
    desc.centres = centres;
    desc.hooks = paper_hooks();
    need(dgfem_matrix_create(&desc, &p->matrix), "matrix");
    p->rhs = need_reals((size_t)p->matrix->size);
    p->x = need_reals((size_t)p->matrix->size);
    free(sizes);
    free(pairs);
    free(centres);
}

static inline void poisson_assemble_cell(poisson *p, int cell) {
    int nb = poisson_basis_count(p), n = p->n;
    double x[POISSON_GAUSS], w[POISSON_GAUSS], v[POISSON_BASIS], d[POISSON_BASIS][2], h = 1.0 / n;
    double *k = dgfem_matrix_block(p->matrix, cell, cell), *rhs = p->rhs + cell * nb;
    gauss(POISSON_GAUSS, x, w);
    for (int q = 0; q < POISSON_GAUSS * POISSON_GAUSS; q++) {
        double a = x[q % POISSON_GAUSS], b = x[q / POISSON_GAUSS];
        double weight = w[q % POISSON_GAUSS] * w[q / POISSON_GAUSS] * h * h;
        poisson_basis(p, a - 0.5, b - 0.5, v, d);
        for (int i = 0; i < nb; i++) {
            rhs[i] += weight * p->f((cell % n + a) * h, (cell / n + b) * h) * v[i];
            for (int j = 0; j < nb; j++) k[i * nb + j] += weight * (d[i][0] * d[j][0] + d[i][1] * d[j][1]);
        }
    }
}

/* One edge with its normal along +x (axis 0) or +y (axis 1) out of cell `lower`; a cell that is not there is
   DGFEM_NONE. */
static inline void poisson_assemble_edge(poisson *p, int lower, int upper, int axis) {
    int nb = poisson_basis_count(p), n = p->n, cell[2], sides = lower != DGFEM_NONE && upper != DGFEM_NONE ? 2 : 1;
    double x[POISSON_GAUSS], w[POISSON_GAUSS], v[2][POISSON_BASIS], d[2][POISSON_BASIS][2], h = 1.0 / n;
    double eta = p->eta / h * (sides == 1 ? p->boundary : 1), sign[2], place[2];
    if (sides == 2) cell[0] = lower, cell[1] = upper, sign[0] = 1, sign[1] = -1, place[0] = 0.5, place[1] = -0.5;
    else if (upper == DGFEM_NONE) cell[0] = lower, sign[0] = 1, place[0] = 0.5;
    else cell[0] = upper, sign[0] = -1, place[0] = -0.5;
    gauss(POISSON_GAUSS, x, w);
    for (int q = 0; q < POISSON_GAUSS; q++) {
        double along = x[q] - 0.5, weight = w[q] * h, g = 0;
        for (int s = 0; s < sides; s++)
            poisson_basis(p, axis == 0 ? place[s] : along, axis == 0 ? along : place[s], v[s], d[s]);
        if (sides == 1) {
            double across = (axis == 0 ? cell[0] % n : cell[0] / n) + place[0] + 0.5;
            double beside = (axis == 0 ? cell[0] / n : cell[0] % n) + x[q];
            g = axis == 0 ? p->g(across * h, beside * h) : p->g(beside * h, across * h);
        }
        for (int r = 0; r < sides; r++)
            for (int i = 0; i < nb; i++) {
                /* the normal points along +axis; on a one-sided edge `sign` turns it outward */
                double jump = sign[r] * v[r][i], flux = p->consistent ? d[r][i][axis] / sides : 0;
                if (sides == 1) p->rhs[cell[r] * nb + i] += weight * g * (eta * v[r][i] - sign[r] * flux);
                for (int s = 0; s < sides; s++) {
                    double *k = cell[r] >= cell[s] ? dgfem_matrix_block(p->matrix, cell[r], cell[s]) : NULL;
                    for (int j = 0; k && j < nb; j++) {
                        double other = sign[s] * v[s][j], back = p->consistent ? d[s][j][axis] / sides : 0;
                        k[i * nb + j] += weight * (eta * jump * other - jump * back - flux * other);
                    }
                }
            }
    }
}

static inline void poisson_assemble(poisson *p) {
    int n = p->n;
    poisson_create_matrix(p);
    for (int c = 0; c < n * n; c++) {
        poisson_assemble_cell(p, c);
        poisson_assemble_edge(p, c, c % n + 1 < n ? c + 1 : DGFEM_NONE, 0);
        poisson_assemble_edge(p, c, c / n + 1 < n ? c + n : DGFEM_NONE, 1);
        if (c % n == 0) poisson_assemble_edge(p, DGFEM_NONE, c, 0);
        if (c / n == 0) poisson_assemble_edge(p, DGFEM_NONE, c, 1);
    }
}

/* Solves; where the matrix is not positive definite, densely. Returns 1 where it was, 0 where not, -1 where it is
   singular. */
static inline int poisson_solve(poisson *p) {
    poisson_assemble(p);
    if (matrix_solve(p->matrix, p->rhs, p->x)) return 1;
    double *dense = matrix_dense(p->matrix);
    memcpy(p->x, p->rhs, (size_t)p->matrix->size * sizeof(double));
    int regular = dense_solve(dense, p->matrix->size, p->x);
    free(dense);
    return regular ? 0 : -1;
}

static inline double poisson_value(const poisson *p, int cell, double a, double b) {
    double v[POISSON_BASIS], d[POISSON_BASIS][2], sum = 0;
    int nb = poisson_basis_count(p);
    poisson_basis(p, a - 0.5, b - 0.5, v, d);
    for (int i = 0; i < nb; i++) sum += v[i] * p->x[cell * nb + i];
    return sum;
}

/* L2 norm of u_h - u. */
static inline double poisson_error(const poisson *p) {
    double x[POISSON_GAUSS], w[POISSON_GAUSS], sum = 0, h = 1.0 / p->n;
    gauss(POISSON_GAUSS, x, w);
    for (int c = 0; c < p->n * p->n; c++)
        for (int q = 0; q < POISSON_GAUSS * POISSON_GAUSS; q++) {
            double a = x[q % POISSON_GAUSS], b = x[q / POISSON_GAUSS];
            double e = poisson_value(p, c, a, b) - p->exact((c % p->n + a) * h, (c / p->n + b) * h);
            sum += w[q % POISSON_GAUSS] * w[q / POISSON_GAUSS] * h * h * e * e;
        }
    return sqrt(sum);
}

/* Root mean square of the jump over interior edges. */
static inline double poisson_jump(const poisson *p) {
    double x[POISSON_GAUSS], w[POISSON_GAUSS], sum = 0, length = 0;
    int n = p->n;
    gauss(POISSON_GAUSS, x, w);
    for (int c = 0; c < n * n; c++)
        for (int q = 0; q < POISSON_GAUSS; q++) {
            if (c % n + 1 < n) {
                double e = poisson_value(p, c, 1, x[q]) - poisson_value(p, c + 1, 0, x[q]);
                sum += w[q] * e * e, length += w[q];
            }
            if (c / n + 1 < n) {
                double e = poisson_value(p, c, x[q], 1) - poisson_value(p, c + n, x[q], 0);
                sum += w[q] * e * e, length += w[q];
            }
        }
    return sqrt(sum / length);
}

static inline void poisson_free(poisson *p) {
    dgfem_matrix_destroy(p->matrix);
    free(p->rhs);
    free(p->x);
    p->matrix = NULL, p->rhs = p->x = NULL;
}

/* ---- continuous bilinear elements, u = 0 on the boundary ---- */

typedef struct bilinear {
    int n;
    plane_fn f, exact;
    dgfem_matrix *matrix; /* one unknown per inner node */
    double *x;
} bilinear;

static inline int bilinear_node(const bilinear *b, int i, int j) {
    if (i < 1 || j < 1 || i >= b->n || j >= b->n) return DGFEM_NONE;
    return i - 1 + (b->n - 1) * (j - 1);
}

static inline void bilinear_solve(bilinear *b) {
    int n = b->n, nodes = (n - 1) * (n - 1), pair = 0;
    dgfem_matrix_desc desc = dgfem_default_matrix_desc();
    int *sizes = (int *)need_memory((size_t)nodes, sizeof *sizes);
    int *pairs = (int *)need_memory(8 * (size_t)nodes, sizeof *pairs);
    dgfem_vec3 *centres = (dgfem_vec3 *)need_memory((size_t)nodes, sizeof *centres);
    double x[POISSON_GAUSS], w[POISSON_GAUSS], h = 1.0 / n, *rhs = need_reals((size_t)nodes);
    for (int v = 0; v < nodes; v++) {
        int i = v % (n - 1) + 1, j = v / (n - 1) + 1;
        const int next[4][2] = {{i + 1, j}, {i, j + 1}, {i + 1, j + 1}, {i - 1, j + 1}};
        sizes[v] = 1;
        centres[v] = vec3(i, j, 0);
        for (int k = 0; k < 4; k++)
            if (bilinear_node(b, next[k][0], next[k][1]) != DGFEM_NONE)
                pairs[pair++] = v, pairs[pair++] = bilinear_node(b, next[k][0], next[k][1]);
    }
    desc.block_count = nodes, desc.block_sizes = sizes;
    desc.pairs = pairs, desc.pair_count = pair / 2;
    desc.centres = centres;
    desc.hooks = paper_hooks();
    need(dgfem_matrix_create(&desc, &b->matrix), "matrix");
    b->x = need_reals((size_t)nodes);
    gauss(POISSON_GAUSS, x, w);
    for (int c = 0; c < n * n; c++)
        for (int q = 0; q < POISSON_GAUSS * POISSON_GAUSS; q++) {
            double s = x[q % POISSON_GAUSS], t = x[q / POISSON_GAUSS];
            double weight = w[q % POISSON_GAUSS] * w[q / POISSON_GAUSS] * h * h;
            const double v[4] = {(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t};
            const double dx[4] = {t - 1, 1 - t, -t, t}, dy[4] = {s - 1, -s, 1 - s, s};
            for (int i = 0; i < 4; i++) {
                int row = bilinear_node(b, c % n + i % 2, c / n + i / 2);
                if (row == DGFEM_NONE) continue;
                rhs[row] += weight * v[i] * b->f((c % n + s) * h, (c / n + t) * h);
                for (int j = 0; j < 4; j++) {
                    int column = bilinear_node(b, c % n + j % 2, c / n + j / 2);
                    if (column == DGFEM_NONE || column > row) continue;
                    *dgfem_matrix_block(b->matrix, row, column) += weight * (dx[i] * dx[j] + dy[i] * dy[j]) / (h * h);
                }
            }
        }
    if (!matrix_solve(b->matrix, rhs, b->x)) need(DGFEM_ERROR_NOT_POSITIVE_DEFINITE, "bilinear elements");
    free(sizes);
    free(pairs);
    free(centres);
    free(rhs);
}

static inline double bilinear_error(const bilinear *b) {
    double x[POISSON_GAUSS], w[POISSON_GAUSS], sum = 0, h = 1.0 / b->n;
    int n = b->n;
    gauss(POISSON_GAUSS, x, w);
    for (int c = 0; c < n * n; c++)
        for (int q = 0; q < POISSON_GAUSS * POISSON_GAUSS; q++) {
            double s = x[q % POISSON_GAUSS], t = x[q / POISSON_GAUSS], e = -b->exact((c % n + s) * h, (c / n + t) * h);
            const double v[4] = {(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t};
            for (int i = 0; i < 4; i++) {
                int node = bilinear_node(b, c % n + i % 2, c / n + i / 2);
                if (node != DGFEM_NONE) e += v[i] * b->x[node];
            }
            sum += w[q % POISSON_GAUSS] * w[q / POISSON_GAUSS] * h * h * e * e;
        }
    return sqrt(sum);
}

static inline void bilinear_free(bilinear *b) {
    dgfem_matrix_destroy(b->matrix);
    free(b->x);
}

#endif
