#pragma once
#include "base.c"
/* Small dense algebra: vectors, 3x3 matrices, polar rotation, symmetric eigenvectors, dense Cholesky. */

static dgfem_vec3 dgfemi_vec3(dgfem_real x, dgfem_real y, dgfem_real z) {
    dgfem_vec3 v;
    v.x = x, v.y = y, v.z = z;
    return v;
}
static dgfem_vec3 dgfemi_add(dgfem_vec3 a, dgfem_vec3 b) { return dgfemi_vec3(a.x + b.x, a.y + b.y, a.z + b.z); }
static dgfem_vec3 dgfemi_sub(dgfem_vec3 a, dgfem_vec3 b) { return dgfemi_vec3(a.x - b.x, a.y - b.y, a.z - b.z); }
static dgfem_vec3 dgfemi_scale(dgfem_real s, dgfem_vec3 a) { return dgfemi_vec3(s * a.x, s * a.y, s * a.z); }
static dgfem_vec3 dgfemi_add_scaled(dgfem_vec3 a, dgfem_real s, dgfem_vec3 b) {
    return dgfemi_vec3(a.x + s * b.x, a.y + s * b.y, a.z + s * b.z);
}
static dgfem_real dgfemi_dot(dgfem_vec3 a, dgfem_vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static dgfem_vec3 dgfemi_cross(dgfem_vec3 a, dgfem_vec3 b) {
    return dgfemi_vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
static dgfem_real dgfemi_norm(dgfem_vec3 a) { return dgfemi_sqrt(dgfemi_dot(a, a)); }
static dgfem_real dgfemi_distance(dgfem_vec3 a, dgfem_vec3 b) { return dgfemi_norm(dgfemi_sub(a, b)); }
static dgfem_vec3 dgfemi_min3(dgfem_vec3 a, dgfem_vec3 b) {
    return dgfemi_vec3(dgfemi_min(a.x, b.x), dgfemi_min(a.y, b.y), dgfemi_min(a.z, b.z));
}
static dgfem_vec3 dgfemi_max3(dgfem_vec3 a, dgfem_vec3 b) {
    return dgfemi_vec3(dgfemi_max(a.x, b.x), dgfemi_max(a.y, b.y), dgfemi_max(a.z, b.z));
}
static int dgfemi_is_finite3(dgfem_vec3 a) {
    return dgfemi_is_finite(a.x) && dgfemi_is_finite(a.y) && dgfemi_is_finite(a.z);
}

/* Coordinate 0, 1, 2 of a vector. */
static dgfem_real dgfemi_axis(dgfem_vec3 a, int axis) { return axis == 0 ? a.x : axis == 1 ? a.y : a.z; }

/* Unit vector; the zero vector stays zero. */
static dgfem_vec3 dgfemi_normalized(dgfem_vec3 a) {
    dgfem_real largest = dgfemi_max(dgfemi_abs(a.x), dgfemi_max(dgfemi_abs(a.y), dgfemi_abs(a.z)));
    if (!(largest > 0)) return dgfemi_vec3(0, 0, 0);
    a = dgfemi_vec3(a.x / largest, a.y / largest, a.z / largest); /* the squares neither overflow nor vanish */
    return dgfemi_scale(1 / dgfemi_norm(a), a);
}

/* ---- 3x3 matrices ---- */

static dgfem_mat3 dgfemi_identity(void) {
    dgfem_mat3 a;
    memset(&a, 0, sizeof a);
    a.m[0][0] = a.m[1][1] = a.m[2][2] = 1;
    return a;
}

static dgfem_vec3 dgfemi_multiply(const dgfem_mat3 *a, dgfem_vec3 v) {
    return dgfemi_vec3(a->m[0][0] * v.x + a->m[0][1] * v.y + a->m[0][2] * v.z,
                       a->m[1][0] * v.x + a->m[1][1] * v.y + a->m[1][2] * v.z,
                       a->m[2][0] * v.x + a->m[2][1] * v.y + a->m[2][2] * v.z);
}

static dgfem_vec3 dgfemi_multiply_transposed(const dgfem_mat3 *a, dgfem_vec3 v) {
    return dgfemi_vec3(a->m[0][0] * v.x + a->m[1][0] * v.y + a->m[2][0] * v.z,
                       a->m[0][1] * v.x + a->m[1][1] * v.y + a->m[2][1] * v.z,
                       a->m[0][2] * v.x + a->m[1][2] * v.y + a->m[2][2] * v.z);
}

static dgfem_mat3 dgfemi_multiply3(const dgfem_mat3 *a, const dgfem_mat3 *b) {
    dgfem_mat3 c;
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            c.m[i][j] = a->m[i][0] * b->m[0][j] + a->m[i][1] * b->m[1][j] + a->m[i][2] * b->m[2][j];
    return c;
}

static dgfem_mat3 dgfemi_transposed(const dgfem_mat3 *a) {
    dgfem_mat3 t;
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) t.m[i][j] = a->m[j][i];
    return t;
}

static dgfem_real dgfemi_trace(const dgfem_mat3 *a) { return a->m[0][0] + a->m[1][1] + a->m[2][2]; }

static dgfem_real dgfemi_determinant(const dgfem_mat3 *a) {
    return a->m[0][0] * (a->m[1][1] * a->m[2][2] - a->m[1][2] * a->m[2][1]) -
           a->m[0][1] * (a->m[1][0] * a->m[2][2] - a->m[1][2] * a->m[2][0]) +
           a->m[0][2] * (a->m[1][0] * a->m[2][1] - a->m[1][1] * a->m[2][0]);
}

static dgfem_vec3 dgfemi_column(const dgfem_mat3 *a, int j) { return dgfemi_vec3(a->m[0][j], a->m[1][j], a->m[2][j]); }

static void dgfemi_set_column(dgfem_mat3 *a, int j, dgfem_vec3 v) { a->m[0][j] = v.x, a->m[1][j] = v.y, a->m[2][j] = v.z; }

/* a += s * u v^T */
static void dgfemi_add_outer(dgfem_mat3 *a, dgfem_real s, dgfem_vec3 u, dgfem_vec3 v) {
    dgfem_real su[3], w[3];
    int i, j;
    su[0] = s * u.x, su[1] = s * u.y, su[2] = s * u.z;
    w[0] = v.x, w[1] = v.y, w[2] = v.z;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) a->m[i][j] += su[i] * w[j];
}

static int dgfemi_is_finite_mat3(const dgfem_mat3 *a) {
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            if (!dgfemi_is_finite(a->m[i][j])) return 0;
    return 1;
}

/* ---- symmetric eigenvectors by cyclic Jacobi rotations ---- */

static void dgfemi_jacobi_rotate(dgfem_mat3 *a, dgfem_mat3 *v, int p, int q) {
    dgfem_real theta, t, c, s;
    int k;
    if (a->m[p][q] == 0) return;
    theta = (a->m[q][q] - a->m[p][p]) / (2 * a->m[p][q]);
    t = 1 / (dgfemi_abs(theta) + dgfemi_sqrt(theta * theta + 1));
    if (theta < 0) t = -t;
    c = 1 / dgfemi_sqrt(t * t + 1);
    s = t * c;
    for (k = 0; k < 3; k++) {
        dgfem_real x = a->m[k][p], y = a->m[k][q];
        a->m[k][p] = c * x - s * y, a->m[k][q] = s * x + c * y;
    }
    for (k = 0; k < 3; k++) {
        dgfem_real x = a->m[p][k], y = a->m[q][k];
        a->m[p][k] = c * x - s * y, a->m[q][k] = s * x + c * y;
    }
    for (k = 0; k < 3; k++) {
        dgfem_real x = v->m[k][p], y = v->m[k][q];
        v->m[k][p] = c * x - s * y, v->m[k][q] = s * x + c * y;
    }
}

DGFEM_API void dgfem_eigen_symmetric(dgfem_mat3 a, dgfem_real values[3], dgfem_mat3 *vectors) {
    enum { MAX_SWEEPS = 16 }; /* convergence is quadratic: six suffice */
    dgfem_mat3 v = dgfemi_identity(), sorted;
    int order[3] = {0, 1, 2};
    int sweep, i, j;
    for (sweep = 0; sweep < MAX_SWEEPS; sweep++) {
        dgfem_real off = dgfemi_abs(a.m[0][1]) + dgfemi_abs(a.m[0][2]) + dgfemi_abs(a.m[1][2]);
        dgfem_real diagonal = dgfemi_abs(a.m[0][0]) + dgfemi_abs(a.m[1][1]) + dgfemi_abs(a.m[2][2]);
        if (!(off > DGFEM_EPSILON * DGFEM_R(1e-3) * diagonal)) break;
        dgfemi_jacobi_rotate(&a, &v, 0, 1);
        dgfemi_jacobi_rotate(&a, &v, 0, 2);
        dgfemi_jacobi_rotate(&a, &v, 1, 2);
    }
    for (i = 0; i < 2; i++)
        for (j = 0; j < 2 - i; j++)
            if (a.m[order[j]][order[j]] > a.m[order[j + 1]][order[j + 1]]) {
                int swap = order[j];
                order[j] = order[j + 1], order[j + 1] = swap;
            }
    for (i = 0; i < 3; i++) {
        values[i] = a.m[order[i]][order[i]];
        dgfemi_set_column(&sorted, i, dgfemi_column(&v, order[i]));
    }
    if (dgfemi_determinant(&sorted) < 0) dgfemi_set_column(&sorted, 2, dgfemi_scale(-1, dgfemi_column(&sorted, 2)));
    *vectors = sorted;
}

/* ---- polar rotation ---- */

/* F = U diag(sigma) V^T with V the eigenvectors of F^T F. The two largest singular values give two columns of U; the
   third is their cross product, which also makes det(U V^T) = +1 and so flips the smallest singular vector of an
   inverted F. */
DGFEM_API dgfem_mat3 dgfem_rotation_of(dgfem_mat3 f, dgfem_mat3 fallback) {
    dgfem_mat3 ft, gram, v, u, vt;
    dgfem_real squares[3], sigma1, sigma2, sigma3;
    dgfem_vec3 u1, u2;
    if (!dgfemi_is_finite_mat3(&f)) return fallback;
    ft = dgfemi_transposed(&f);
    gram = dgfemi_multiply3(&ft, &f);
    dgfem_eigen_symmetric(gram, squares, &v);
    u1 = dgfemi_multiply(&f, dgfemi_column(&v, 2));
    sigma1 = dgfemi_norm(u1);
    if (!(sigma1 > 0)) return fallback;
    u1 = dgfemi_scale(1 / sigma1, u1);
    u2 = dgfemi_multiply(&f, dgfemi_column(&v, 1));
    u2 = dgfemi_add_scaled(u2, -dgfemi_dot(u1, u2), u1);
    sigma2 = dgfemi_norm(u2);
    sigma3 = dgfemi_norm(dgfemi_multiply(&f, dgfemi_column(&v, 0)));
    if (!(sigma2 + sigma3 > DGFEM_R(1e-6) * sigma1) || !(sigma2 > 0)) return fallback;
    u2 = dgfemi_scale(1 / sigma2, u2);
    dgfemi_set_column(&u, 2, u1);
    dgfemi_set_column(&u, 1, u2);
    dgfemi_set_column(&u, 0, dgfemi_cross(u2, u1)); /* v is right-handed: v0 = v1 x v2 */
    vt = dgfemi_transposed(&v);
    return dgfemi_multiply3(&u, &vt);
}

/* ---- dense Cholesky of small blocks, row-major ---- */

/* Lower triangle of a becomes L with A = L L^T. 0 when a pivot is not positive. */
static int dgfemi_cholesky_dense(dgfem_real *a, int n) {
    int i, j, k;
    for (j = 0; j < n; j++) {
        dgfem_real pivot = a[j * n + j];
        for (k = 0; k < j; k++) pivot -= a[j * n + k] * a[j * n + k];
        if (!(pivot > 0) || !dgfemi_is_finite(pivot)) return 0;
        pivot = dgfemi_sqrt(pivot);
        a[j * n + j] = pivot;
        for (i = j + 1; i < n; i++) {
            dgfem_real sum = a[i * n + j];
            for (k = 0; k < j; k++) sum -= a[i * n + k] * a[j * n + k];
            a[i * n + j] = sum / pivot;
        }
    }
    return 1;
}

/* x = (L L^T)^-1 x for `columns` interleaved right-hand sides: x[row * columns + column]. */
static void dgfemi_cholesky_dense_solve(const dgfem_real *l, int n, dgfem_real *x, int columns) {
    int i, k, c;
    for (i = 0; i < n; i++)
        for (c = 0; c < columns; c++) {
            dgfem_real sum = x[i * columns + c];
            for (k = 0; k < i; k++) sum -= l[i * n + k] * x[k * columns + c];
            x[i * columns + c] = sum / l[i * n + i];
        }
    for (i = n - 1; i >= 0; i--)
        for (c = 0; c < columns; c++) {
            dgfem_real sum = x[i * columns + c];
            for (k = i + 1; k < n; k++) sum -= l[k * n + i] * x[k * columns + c];
            x[i * columns + c] = sum / l[i * n + i];
        }
}
