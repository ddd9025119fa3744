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
static dgfem_real dgfemi_norm(dgfem_vec3 a) { /* in double, where squares of float neither overflow nor vanish */
    double x = (double)a.x, y = (double)a.y, z = (double)a.z;
    return (dgfem_real)sqrt(x * x + y * y + z * z);
}
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

/* Euclidean norm of a long vector, of any magnitude. */
static double dgfemi_vector_norm(int count, const dgfem_vec3 *x) {
    double largest = 0, sum = 0;
    int i;
    for (i = 0; i < count; i++) {
        dgfem_real size = dgfemi_max(dgfemi_abs(x[i].x), dgfemi_max(dgfemi_abs(x[i].y), dgfemi_abs(x[i].z)));
        if ((double)size > largest) largest = (double)size;
    }
    if (!(largest > 0)) return 0;
    for (i = 0; i < count; i++) {
        double a = (double)x[i].x / largest, b = (double)x[i].y / largest, c = (double)x[i].z / largest;
        sum += a * a + b * b + c * c;
    }
    return largest * sqrt(sum);
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
        for (j = 0; j < 3; j++) c.m[i][j] = a->m[i][0] * b->m[0][j] + a->m[i][1] * b->m[1][j] + a->m[i][2] * b->m[2][j];
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

static void dgfemi_set_column(dgfem_mat3 *a, int j, dgfem_vec3 v) {
    a->m[0][j] = v.x, a->m[1][j] = v.y, a->m[2][j] = v.z;
}

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

/* Turns columns p and q of f, and those of v with them, until they are orthogonal. 0 when they are already. */
static int dgfemi_orthogonalize_columns(dgfem_mat3 *f, dgfem_mat3 *v, int p, int q) {
    dgfem_vec3 x = dgfemi_column(f, p), y = dgfemi_column(f, q), vx = dgfemi_column(v, p), vy = dgfemi_column(v, q);
    dgfem_real xx = dgfemi_dot(x, x), yy = dgfemi_dot(y, y), xy = dgfemi_dot(x, y), theta, t, c, s;
    if (!(dgfemi_abs(xy) > DGFEM_EPSILON * dgfemi_sqrt(xx) * dgfemi_sqrt(yy)) || xy == 0) return 0;
    theta = (yy - xx) / (2 * xy);
    t = 1 / (dgfemi_abs(theta) + dgfemi_sqrt(theta * theta + 1));
    if (theta < 0) t = -t;
    c = 1 / dgfemi_sqrt(t * t + 1);
    s = t * c;
    dgfemi_set_column(f, p, dgfemi_add_scaled(dgfemi_scale(c, x), -s, y));
    dgfemi_set_column(f, q, dgfemi_add_scaled(dgfemi_scale(s, x), c, y));
    dgfemi_set_column(v, p, dgfemi_add_scaled(dgfemi_scale(c, vx), -s, vy));
    dgfemi_set_column(v, q, dgfemi_add_scaled(dgfemi_scale(s, vx), c, vy));
    return 1;
}

/* F is far from every rotation where |F^T F - I| is not small: no singular value is below 0.4. NaN is far. */
static int dgfemi_is_near_rotation(const dgfem_mat3 *f) {
    dgfem_vec3 x = dgfemi_column(f, 0), y = dgfemi_column(f, 1), z = dgfemi_column(f, 2);
    const dgfem_real stretch = DGFEM_R(0.4), shear = DGFEM_R(0.2);
    return dgfemi_abs(dgfemi_dot(x, x) - 1) < stretch && dgfemi_abs(dgfemi_dot(y, y) - 1) < stretch &&
           dgfemi_abs(dgfemi_dot(z, z) - 1) < stretch && dgfemi_abs(dgfemi_dot(x, y)) < shear &&
           dgfemi_abs(dgfemi_dot(x, z)) < shear && dgfemi_abs(dgfemi_dot(y, z)) < shear &&
           dgfemi_determinant(f) > 0;
}

/* The polar rotation of a matrix near it, by Newton's iteration R = (R + R^-T) / 2: it converges quadratically, so that
   the last change tells that the next one would be round-off. */
static dgfem_mat3 dgfemi_rotation_by_newton(dgfem_mat3 r) {
    enum { MAX_STEPS = 8 }; /* six suffice */
    const dgfem_real enough = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-8);
    dgfem_real change = 1;
    int step, i, j;
    for (step = 0; step < MAX_STEPS && change > enough; step++) {
        dgfem_vec3 c[3], x = dgfemi_column(&r, 0), y = dgfemi_column(&r, 1), z = dgfemi_column(&r, 2);
        dgfem_real half;
        c[0] = dgfemi_cross(y, z), c[1] = dgfemi_cross(z, x), c[2] = dgfemi_cross(x, y);
        half = DGFEM_R(0.5) / dgfemi_dot(x, c[0]);
        change = 0;
        for (j = 0; j < 3; j++)
            for (i = 0; i < 3; i++) {
                dgfem_real next = DGFEM_R(0.5) * r.m[i][j] + half * dgfemi_axis(c[j], i);
                change = dgfemi_max(change, dgfemi_abs(next - r.m[i][j]));
                r.m[i][j] = next;
            }
    }
    return r;
}

/* Where F is no rotation with a moderate strain:
   F V = U diag(sigma) by one-sided Jacobi rotations, which unlike the eigenvectors of F^T F see small singular values
   as exactly as F holds them. The two largest give two columns of U and of V; the third ones are their cross products,
   which makes det(U V^T) = +1 and so flips the smallest singular vector of an inverted F. */
DGFEM_API dgfem_mat3 dgfem_rotation_of(dgfem_mat3 f, dgfem_mat3 fallback) {
    enum { MAX_SWEEPS = 16 }; /* convergence is quadratic: six suffice */
    const dgfem_real bound = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-6);
    dgfem_mat3 v = dgfemi_identity(), r;
    dgfem_vec3 u1, u2, v1, v2;
    dgfem_real sigma[3], largest = 0;
    int first = 0, second, sweep, i;
    if (dgfemi_is_near_rotation(&f)) return dgfemi_rotation_by_newton(f);
    if (!dgfemi_is_finite_mat3(&f)) return fallback;
    for (i = 0; i < 9; i++) largest = dgfemi_max(largest, dgfemi_abs(f.m[i / 3][i % 3]));
    if (!(largest > 0)) return fallback;
    for (i = 0; i < 9; i++) f.m[i / 3][i % 3] /= largest; /* the squares neither overflow nor vanish */
    for (sweep = 0; sweep < MAX_SWEEPS; sweep++) {
        int turned = dgfemi_orthogonalize_columns(&f, &v, 0, 1);
        turned |= dgfemi_orthogonalize_columns(&f, &v, 0, 2);
        turned |= dgfemi_orthogonalize_columns(&f, &v, 1, 2);
        if (!turned) break;
    }
    for (i = 0; i < 3; i++) sigma[i] = dgfemi_norm(dgfemi_column(&f, i));
    for (i = 1; i < 3; i++)
        if (sigma[i] > sigma[first]) first = i;
    second = first == 0 ? 1 : 0;
    if (sigma[3 - first - second] > sigma[second]) second = 3 - first - second;
    if (!(sigma[second] + sigma[3 - first - second] > bound * sigma[first])) return fallback;
    u1 = dgfemi_scale(1 / sigma[first], dgfemi_column(&f, first));
    u2 = dgfemi_scale(1 / sigma[second], dgfemi_column(&f, second));
    v1 = dgfemi_column(&v, first), v2 = dgfemi_column(&v, second);
    memset(&r, 0, sizeof r);
    dgfemi_add_outer(&r, 1, u1, v1);
    dgfemi_add_outer(&r, 1, u2, v2);
    dgfemi_add_outer(&r, 1, dgfemi_cross(u1, u2), dgfemi_cross(v1, v2));
    return r;
}

/* ---- dense Cholesky of small blocks, row-major ---- */

/* Lower triangle of a becomes L with A = L L^T. 0 when a pivot is not positive. */
static int dgfemi_cholesky_dense(dgfem_real *a, int n) {
    size_t stride = (size_t)n;
    int i, j, k;
    for (j = 0; j < n; j++) {
        dgfem_real *row = a + (size_t)j * stride, pivot = row[j];
        for (k = 0; k < j; k++) pivot -= row[k] * row[k];
        if (!(pivot > 0) || !dgfemi_is_finite(pivot)) return 0;
        pivot = dgfemi_sqrt(pivot);
        row[j] = pivot;
        for (i = j + 1; i < n; i++) {
            dgfem_real *lower = a + (size_t)i * stride, sum = lower[j];
            for (k = 0; k < j; k++) sum -= lower[k] * row[k];
            lower[j] = sum / pivot;
        }
    }
    return 1;
}

/* The same for the Gram matrix of functions of which some may depend on those before them, as far as round-off can
   tell: their rows become zero, which drops them from the solves below. */
static void dgfemi_cholesky_dropping(dgfem_real *a, int n) {
    int i, j, k;
    for (i = 0; i < n; i++) {
        dgfem_real *row = a + i * n, norm = row[i], pivot = norm;
        for (j = 0; j < i; j++) {
            const dgfem_real *upper = a + j * n;
            for (k = 0; k < j; k++) row[j] -= row[k] * upper[k];
            row[j] = upper[j] > 0 ? row[j] / upper[j] : 0;
            pivot -= row[j] * row[j];
        }
        row[i] = pivot > 1000 * DGFEM_EPSILON * norm ? dgfemi_sqrt(pivot) : 0;
        for (j = 0; row[i] == 0 && j < i; j++) row[j] = 0;
    }
}

/* x = L^-1 x for `columns` interleaved right-hand sides: x[row * columns + column]; zero in dropped rows. */
static void dgfemi_forward_dense(const dgfem_real *l, int n, dgfem_real *x, int columns) {
    int i, k, c;
    for (i = 0; i < n; i++) {
        const dgfem_real *row = l + (size_t)i * (size_t)n;
        dgfem_real *xi = x + (size_t)i * (size_t)columns;
        for (c = 0; c < columns; c++) {
            dgfem_real sum = xi[c];
            for (k = 0; k < i; k++) sum -= row[k] * x[(size_t)k * (size_t)columns + (size_t)c];
            xi[c] = row[i] > 0 ? sum / row[i] : 0;
        }
    }
}

/* x = (L L^T)^-1 x for right-hand sides as above. */
static void dgfemi_cholesky_dense_solve(const dgfem_real *l, int n, dgfem_real *x, int columns) {
    int i, k, c;
    dgfemi_forward_dense(l, n, x, columns);
    for (i = n - 1; i >= 0; i--) {
        dgfem_real *xi = x + (size_t)i * (size_t)columns, pivot = l[(size_t)i * (size_t)n + (size_t)i];
        for (c = 0; c < columns; c++) {
            dgfem_real sum = xi[c];
            for (k = i + 1; k < n; k++)
                sum -= l[(size_t)k * (size_t)n + (size_t)i] * x[(size_t)k * (size_t)columns + (size_t)c];
            xi[c] = pivot > 0 ? sum / pivot : 0;
        }
    }
}
