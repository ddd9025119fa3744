#pragma once
#include "moments.c"
/* The polynomial basis of an element: centred, scaled monomials ((x - c)/s)^(i,j,k), i + j + k <= degree. Evaluation,
   gradients, products by exponent, and the exact move of a polynomial to another centre and scale. */

#define DGFEM_MAX_BASIS 20 /* dgfem_monomial_count(DGFEM_MAX_DEGREE) */

/* Exponents of the monomials up to degree 3, in order. */
static const unsigned char dgfemi_exponents[DGFEM_MAX_BASIS][3] = {
    {0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {2, 0, 0}, {1, 1, 0}, {1, 0, 1}, {0, 2, 0}, {0, 1, 1}, {0, 0, 2},
    {3, 0, 0}, {2, 1, 0}, {2, 0, 1}, {1, 2, 0}, {1, 1, 1}, {1, 0, 2}, {0, 3, 0}, {0, 2, 1}, {0, 1, 2}, {0, 0, 3}};

/* Index of the product of monomials i and j. */
static int dgfemi_product_index(int i, int j) {
    const unsigned char *a = dgfemi_exponents[i], *b = dgfemi_exponents[j];
    return dgfem_monomial_index(a[0] + b[0], a[1] + b[1], a[2] + b[2]);
}

/* d/d(axis) of monomial i is (its exponent on the axis) times the monomial returned; DGFEM_NONE where it vanishes. */
static int dgfemi_derivative_index(int i, int axis) {
    static const signed char index[DGFEM_MAX_BASIS][3] = {
        {-1, -1, -1}, {0, -1, -1}, {-1, 0, -1}, {-1, -1, 0}, {1, -1, -1}, {2, 1, -1}, {3, -1, 1},
        {-1, 2, -1},  {-1, 3, 2},  {-1, -1, 3}, {4, -1, -1}, {5, 4, -1},  {6, -1, 4}, {7, 5, -1},
        {8, 6, 5},    {9, -1, 6},  {-1, 7, -1}, {-1, 8, 7},  {-1, 9, 8},  {-1, -1, 9}};
    return index[i][axis];
}

/* values[dgfem_monomial_count(degree)] of all monomials of (x - c)/s. */
static void dgfemi_basis_evaluate(int degree, dgfem_vec3 c, dgfem_real s, dgfem_vec3 x, dgfem_real *values) {
    dgfem_vec3 t = dgfemi_scale(1 / s, dgfemi_sub(x, c));
    values[0] = 1;
    if (degree >= 1) values[1] = t.x, values[2] = t.y, values[3] = t.z;
    for (int i = 4; i < dgfem_monomial_count(degree); i++) {
        const unsigned char *e = dgfemi_exponents[i];
        int axis = e[0] ? 0 : e[1] ? 1 : 2;
        values[i] = dgfemi_axis(t, axis) * values[dgfemi_derivative_index(i, axis)];
    }
}

/* gradients[dgfem_monomial_count(degree)] with respect to x. */
static void dgfemi_basis_gradients(int degree, dgfem_vec3 c, dgfem_real s, dgfem_vec3 x, dgfem_vec3 *gradients) {
    dgfem_real values[DGFEM_MAX_BASIS], g[3];
    dgfemi_basis_evaluate(degree, c, s, x, values);
    for (int i = 0; i < dgfem_monomial_count(degree); i++) {
        for (int axis = 0; axis < 3; axis++) {
            int lower = dgfemi_derivative_index(i, axis);
            g[axis] = lower == DGFEM_NONE ? 0 : (dgfem_real)dgfemi_exponents[i][axis] * values[lower] / s;
        }
        gradients[i] = dgfemi_vec3(g[0], g[1], g[2]);
    }
}

static dgfem_real dgfemi_binomial(int n, int k) {
    static const unsigned char rows[4][4] = {{1, 0, 0, 0}, {1, 1, 0, 0}, {1, 2, 1, 0}, {1, 3, 3, 1}};
    return (dgfem_real)rows[n][k];
}

/* The matrix t that writes each monomial about (c, s) in those about (c_new, s_new):
     N_i(x) = sum_k t[i * n + k] N'_k(x),   n = dgfem_monomial_count(degree)
   from xi = d + r xi' with d = (c_new - c)/s, r = s_new/s, by the binomial theorem on each axis. */
static void dgfemi_basis_shift(int degree, dgfem_vec3 c, dgfem_real s, dgfem_vec3 c_new, dgfem_real s_new,
                               dgfem_real *t) {
    int n = dgfem_monomial_count(degree);
    dgfem_vec3 d = dgfemi_scale(1 / s, dgfemi_sub(c_new, c));
    dgfem_real r = s_new / s, power[3][DGFEM_MAX_DEGREE + 1];
    dgfem_real factor[3][DGFEM_MAX_DEGREE + 1][DGFEM_MAX_DEGREE + 1]; /* of xi'^b in (d + r xi')^a; 0 where b > a */
    memset(factor, 0, sizeof factor);
    for (int axis = 0; axis < 3; axis++) {
        power[axis][0] = 1;
        for (int p = 1; p <= degree; p++) power[axis][p] = power[axis][p - 1] * dgfemi_axis(d, axis);
        for (int a = 0; a <= degree; a++) {
            dgfem_real scale_power = 1;
            for (int b = 0; b <= a; b++, scale_power *= r)
                factor[axis][a][b] = dgfemi_binomial(a, b) * power[axis][a - b] * scale_power;
        }
    }
    for (int i = 0; i < n; i++)
        for (int k = 0; k < n; k++) {
            const unsigned char *a = dgfemi_exponents[i], *b = dgfemi_exponents[k];
            t[i * n + k] = factor[0][a[0]][b[0]] * factor[1][a[1]][b[1]] * factor[2][a[2]][b[2]];
        }
}
