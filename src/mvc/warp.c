#pragma once
#include "conditions.c"
/* Stiffness warping: rotations of elements, elastic forces and stiffness in rotated frames.

   An element's rotation R, from rest X to now x, is the one that minimizes sum mu_i |R (X_i - X_c) - (x_i - x_c)|^2
   (Horn 1987): the unit quaternion of the largest eigenvalue of a symmetric 4 x 4 matrix. With it
     f = -R K (R^T (x - x_c) - (X - X_c)),    K_w = R K R^T */

/* A rotation is not determined where the two largest eigenvalues are closer than this times the size of the matrix,
   or of its value at rest. */
#define DGFEM_MVCI_NO_ROTATION (DGFEM_REAL_IS_FLOAT ? 1e-5 : 1e-8)

/* Eigenvalues of a symmetric 4 x 4 matrix on its diagonal, eigenvectors in the columns of v, by Jacobi's method. */
static void dgfem_mvci_jacobi4(double a[4][4], double v[4][4]) {
    for (int i = 0; i < 16; i++) v[i / 4][i % 4] = i % 5 == 0;
    for (int sweep = 0; sweep < 30; sweep++) {
        double off = 0, all = 0;
        for (int i = 0; i < 16; i++) {
            double square = a[i / 4][i % 4] * a[i / 4][i % 4];
            all += square;
            if (i % 5) off += square;
        }
        if (!(off > 1e-34 * all)) return;
        for (int p = 0; p < 3; p++)
            for (int q = p + 1; q < 4; q++) {
                if (a[p][q] == 0) continue;
                double half = (a[q][q] - a[p][p]) / (2 * a[p][q]);
                double t = (half < 0 ? -1 : 1) / (fabs(half) + sqrt(half * half + 1));
                double c = 1 / sqrt(t * t + 1), s = t * c;
                for (int k = 0; k < 4; k++) {
                    double x = a[k][p], y = a[k][q];
                    a[k][p] = c * x - s * y, a[k][q] = s * x + c * y;
                    x = v[k][p], y = v[k][q];
                    v[k][p] = c * x - s * y, v[k][q] = s * x + c * y;
                }
                for (int k = 0; k < 4; k++) {
                    double x = a[p][k], y = a[q][k];
                    a[p][k] = c * x - s * y, a[q][k] = s * x + c * y;
                }
            }
    }
}

static dgfem_mat3 dgfem_mvci_quaternion_rotation(double w, double x, double y, double z) {
    dgfem_mat3 r;
    r.m[0][0] = (dgfem_real)(w * w + x * x - y * y - z * z);
    r.m[0][1] = (dgfem_real)(2 * (x * y - w * z));
    r.m[0][2] = (dgfem_real)(2 * (x * z + w * y));
    r.m[1][0] = (dgfem_real)(2 * (x * y + w * z));
    r.m[1][1] = (dgfem_real)(w * w - x * x + y * y - z * z);
    r.m[1][2] = (dgfem_real)(2 * (y * z - w * x));
    r.m[2][0] = (dgfem_real)(2 * (x * z - w * y));
    r.m[2][1] = (dgfem_real)(2 * (y * z + w * x));
    r.m[2][2] = (dgfem_real)(w * w - x * x - y * y + z * z);
    return r;
}

/* x = a^-1 b for a symmetric matrix. 0 where not all its pivots are above `least`. */
static int dgfem_mvci_solve3(const double a[3][3], const double b[3], double least, double x[3]) {
    double d0 = a[0][0], l1 = a[1][0] / d0, l2 = a[2][0] / d0, d1 = a[1][1] - l1 * a[1][0];
    double c = a[2][1] - l2 * a[1][0], l3 = c / d1, d2 = a[2][2] - l2 * a[2][0] - l3 * c;
    if (!(d0 > least && d1 > least && d2 > least)) return 0;
    double y1 = b[1] - l1 * b[0], y2 = b[2] - l2 * b[0] - l3 * y1;
    x[2] = y2 / d2;
    x[1] = y1 / d1 - l3 * x[2];
    x[0] = b[0] / d0 - l1 * x[1] - l2 * x[2];
    return 1;
}

/* c = a b. */
static void dgfem_mvci_product3(const double a[3][3], const double b[3][3], double c[3][3]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) c[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j];
}

/* A rotation close to q: (3 q - q q^T q) / 2, for one that is so but for round-off. */
static void dgfem_mvci_straighten(double q[3][3]) {
    double square[3][3], cube[3][3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) square[i][j] = q[i][0] * q[j][0] + q[i][1] * q[j][1] + q[i][2] * q[j][2];
    dgfem_mvci_product3((const double(*)[3])square, (const double(*)[3])q, cube);
    for (int i = 0; i < 9; i++) q[i / 3][i % 3] = (3 * q[i / 3][i % 3] - cube[i / 3][i % 3]) / 2;
}

/* Newton's method for the rotation q that makes tr(q s) greatest, from `last`. With m = q s, a small turn w changes the
   trace by w . axis(m) - w . (tr m - m) w / 2. Of the places where m is symmetric, only the greatest has tr m - m
   positive definite. 0 where that is not reached, or nearly not. */
static int dgfem_mvci_follow(const double s[3][3], double size, const dgfem_mat3 *last, dgfem_mat3 *out) {
    double q[3][3], m[3][3], b[3], w[3], turn[3][3], a[3][3], next[3][3], square = 1;
    for (int i = 0; i < 9; i++) q[i / 3][i % 3] = (double)last->m[i / 3][i % 3];
    dgfem_mvci_straighten(q);
    for (int step = 0; step < 8; step++) {
        dgfem_mvci_product3((const double(*)[3])q, s, m);
        double trace = m[0][0] + m[1][1] + m[2][2];
        for (int i = 0; i < 9; i++) a[i / 3][i % 3] = (i % 4 ? 0 : trace) - (m[i / 3][i % 3] + m[i % 3][i / 3]) / 2;
        b[0] = m[1][2] - m[2][1], b[1] = m[2][0] - m[0][2], b[2] = m[0][1] - m[1][0];
        if (!dgfem_mvci_solve3((const double(*)[3])a, b, 1e-3 * size, w)) return 0;
        if (square < 1e-18) break; /* the turn before was this short: what is left is its square */
        square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
        if (!(square < 4)) return 0;
        double h[3], scale = 2 / (1 + square / 4);
        for (int k = 0; k < 3; k++) h[k] = w[k] / 2;
        for (int i = 0; i < 9; i++)
            turn[i / 3][i % 3] = scale * h[i / 3] * h[i % 3] + (i % 4 ? 0 : 1 - scale * (square / 4));
        turn[0][1] -= scale * h[2], turn[1][0] += scale * h[2];
        turn[0][2] += scale * h[1], turn[2][0] -= scale * h[1];
        turn[1][2] -= scale * h[0], turn[2][1] += scale * h[0];
        dgfem_mvci_product3((const double(*)[3])turn, (const double(*)[3])q, next);
        memcpy(q, next, sizeof q);
    }
    if (!(square < 1e-18)) return 0;
    for (int i = 0; i < 9; i++) out->m[i / 3][i % 3] = (dgfem_real)q[i / 3][i % 3];
    return 1;
}

/* Horn's fit to s = sum of weights times rest (row) times position (column), both about their centres, at rest of trace
   `inertia`; `last` where it is not determined: all in one place, on a line, or inverted like a point reflection. */
static dgfem_mat3 dgfem_mvci_horn(double s[3][3], double inertia, const dgfem_mat3 *last) {
    double a[4][4], v[4][4], size = inertia * inertia;
    int best = 0, second = 1;
    for (int i = 0; i < 9; i++) size += s[i / 3][i % 3] * s[i / 3][i % 3];
    dgfem_mat3 near;
    if (dgfem_mvci_follow((const double(*)[3])s, sqrt(size), last, &near)) return near;
    a[0][0] = s[0][0] + s[1][1] + s[2][2];
    a[0][1] = a[1][0] = s[1][2] - s[2][1];
    a[0][2] = a[2][0] = s[2][0] - s[0][2];
    a[0][3] = a[3][0] = s[0][1] - s[1][0];
    a[1][1] = s[0][0] - s[1][1] - s[2][2];
    a[2][2] = s[1][1] - s[0][0] - s[2][2];
    a[3][3] = s[2][2] - s[0][0] - s[1][1];
    a[1][2] = a[2][1] = s[0][1] + s[1][0];
    a[1][3] = a[3][1] = s[2][0] + s[0][2];
    a[2][3] = a[3][2] = s[1][2] + s[2][1];
    dgfem_mvci_jacobi4(a, v);
    for (int i = 1; i < 4; i++) {
        if (a[i][i] > a[best][best]) second = best, best = i;
        else if (a[i][i] > a[second][second] || second == best) second = i;
    }
    if (!(a[best][best] - a[second][second] > DGFEM_MVCI_NO_ROTATION * sqrt(size))) return *last;
    return dgfem_mvci_quaternion_rotation(v[0][best], v[1][best], v[2][best], v[3][best]);
}

/* The weighted mean of nodal values over an element: of rest places its centroid. */
static dgfem_vec3 dgfem_mvci_element_mean(const dgfem_mvc *body, int e, const dgfem_vec3 *x) {
    const dgfem_mvc_system *system = body->system;
    dgfem_vec3 first = x[system->nodes[system->node_start[e]]], sum = dgfem_mvci_vec3(0, 0, 0);
    for (int i = system->node_start[e]; i < system->node_start[e + 1]; i++)
        sum = dgfem_mvci_axpy(sum, system->share[i], dgfem_mvci_sub(x[system->nodes[i]], first));
    return dgfem_mvci_add(first, sum);
}

static dgfem_mat3 dgfem_mvci_element_rotation(const dgfem_mvc *body, int e, const dgfem_vec3 *x) {
    const dgfem_mvc_system *system = body->system;
    dgfem_vec3 centre = dgfem_mvci_element_mean(body, e, x);
    double s[3][3], inertia = 0;
    memset(s, 0, sizeof s);
    for (int i = system->node_start[e]; i < system->node_start[e + 1]; i++) {
        dgfem_vec3 from = dgfem_mvci_sub(body->rest[system->nodes[i]], body->centre[e]);
        dgfem_vec3 to = dgfem_mvci_sub(x[system->nodes[i]], centre);
        double a[3], b[3];
        a[0] = (double)from.x, a[1] = (double)from.y, a[2] = (double)from.z;
        b[0] = (double)to.x, b[1] = (double)to.y, b[2] = (double)to.z;
        for (int k = 0; k < 9; k++) s[k / 3][k % 3] += (double)system->share[i] * a[k / 3] * b[k % 3];
        inertia += (double)system->share[i] * (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
    }
    return dgfem_mvci_horn(s, inertia, &body->rotation[e]);
}

/* A loop over all elements, nodes or blocks. */
typedef struct dgfem_mvci_pass {
    const dgfem_mvc *body;
    const dgfem_mat3 *rotation; /* [element_count] */
    dgfem_mat3 *rotation_out;
    dgfem_vec3 *force; /* [node_count] */
    dgfem_real factor;
} dgfem_mvci_pass;

static void dgfem_mvci_rotate_range(void *context, int first, int last) {
    const dgfem_mvci_pass *pass = (const dgfem_mvci_pass *)context;
    for (int e = first; e < last; e++)
        pass->rotation_out[e] = dgfem_mvci_element_rotation(pass->body, e, pass->body->position);
}

/* Rotations of all elements at the current positions. */
static void dgfem_mvci_rotations(const dgfem_mvc *body, dgfem_mat3 *out) {
    dgfem_mvci_pass pass;
    memset(&pass, 0, sizeof pass);
    pass.body = body, pass.rotation_out = out;
    if (body->desc.warp) dgfem_mvci_run(&body->hooks, body->element_count, 32, dgfem_mvci_rotate_range, &pass);
    for (int e = 0; !body->desc.warp && e < body->element_count; e++) out[e] = dgfem_mvci_identity();
}

/* ---- forces ---- */

/* y = R^T (x - x_c) - (X - X_c) at the k-th node of an element. */
static dgfem_vec3 dgfem_mvci_local_displacement(const dgfem_mvc *body, int e, int k, const dgfem_mat3 *rotation,
                                                dgfem_vec3 centre) {
    int node = body->system->nodes[body->system->node_start[e] + k];
    dgfem_vec3 now = dgfem_mvci_multiply_transposed(rotation, dgfem_mvci_sub(body->position[node], centre));
    return dgfem_mvci_sub(now, dgfem_mvci_sub(body->rest[node], body->centre[e]));
}

static dgfem_vec3 dgfem_mvci_block_multiply(const dgfem_real *m, dgfem_vec3 v) {
    return dgfem_mvci_vec3(m[0] * v.x + m[1] * v.y + m[2] * v.z, m[3] * v.x + m[4] * v.y + m[5] * v.z,
                           m[6] * v.x + m[7] * v.y + m[8] * v.z);
}

static dgfem_vec3 dgfem_mvci_block_multiply_transposed(const dgfem_real *m, dgfem_vec3 v) {
    return dgfem_mvci_vec3(m[0] * v.x + m[3] * v.y + m[6] * v.z, m[1] * v.x + m[4] * v.y + m[7] * v.z,
                           m[2] * v.x + m[5] * v.y + m[8] * v.z);
}

/* R K y of an element into its part of system->local; returns its elastic energy. */
static dgfem_real dgfem_mvci_element_push(const dgfem_mvc *body, int e, const dgfem_mat3 *rotation) {
    const dgfem_mvc_system *system = body->system;
    const dgfem_real *block = system->stiffness + 9 * system->pair_start[e];
    int start = system->node_start[e], count = system->node_start[e + 1] - start;
    dgfem_vec3 centre = dgfem_mvci_element_mean(body, e, body->position);
    dgfem_vec3 *y = system->local + start, *force = y + system->node_start[body->element_count];
    dgfem_real energy = 0;
    for (int a = 0; a < count; a++) {
        y[a] = dgfem_mvci_local_displacement(body, e, a, rotation, centre);
        force[a] = dgfem_mvci_vec3(0, 0, 0);
        for (int b = 0; b < a; b++, block += 9) {
            force[a] = dgfem_mvci_add(force[a], dgfem_mvci_block_multiply(block, y[b]));
            force[b] = dgfem_mvci_add(force[b], dgfem_mvci_block_multiply_transposed(block, y[a]));
        }
        force[a] = dgfem_mvci_add(force[a], dgfem_mvci_block_multiply(block, y[a]));
        block += 9;
    }
    for (int a = 0; a < count; a++) {
        energy += dgfem_mvci_dot(y[a], force[a]) / 2;
        force[a] = dgfem_mvci_multiply(rotation, force[a]);
    }
    return energy;
}

static void dgfem_mvci_push_range(void *context, int first, int last) {
    const dgfem_mvci_pass *pass = (const dgfem_mvci_pass *)context;
    for (int e = first; e < last; e++) (void)dgfem_mvci_element_push(pass->body, e, &pass->rotation[e]);
}

/* Sums in the order of elements, whatever the threads. */
static void dgfem_mvci_gather_range(void *context, int first, int last) {
    const dgfem_mvci_pass *pass = (const dgfem_mvci_pass *)context;
    const dgfem_mvc_system *system = pass->body->system;
    const dgfem_vec3 *force = system->local + system->node_start[pass->body->element_count];
    for (int i = first; i < last; i++) {
        dgfem_vec3 sum = dgfem_mvci_vec3(0, 0, 0);
        for (int k = system->use_start[i]; k < system->use_start[i + 1]; k++)
            sum = dgfem_mvci_add(sum, force[system->uses[k]]);
        pass->force[i] = sum;
    }
}

/* Elastic force on each node, as R K y. */
static void dgfem_mvci_forces(const dgfem_mvc *body, const dgfem_mat3 *rotation, dgfem_vec3 *out) {
    dgfem_mvci_pass pass;
    memset(&pass, 0, sizeof pass);
    pass.body = body, pass.rotation = rotation, pass.force = out;
    dgfem_mvci_run(&body->hooks, body->element_count, 16, dgfem_mvci_push_range, &pass);
    dgfem_mvci_run(&body->hooks, body->node_count, 64, dgfem_mvci_gather_range, &pass);
}

/* ---- stiffness ---- */

/* sum += factor * R K R^T, transposed where `turned`. */
static void dgfem_mvci_add_rotated(dgfem_real *sum, dgfem_real factor, const dgfem_mat3 *rotation,
                                   const dgfem_real *block, int turned) {
    dgfem_mat3 m, back = dgfem_mvci_transposed(rotation);
    memcpy(&m, block, sizeof m);
    m = dgfem_mvci_multiply3(&m, &back);
    m = dgfem_mvci_multiply3(rotation, &m);
    if (turned) m = dgfem_mvci_transposed(&m);
    for (int i = 0; i < 9; i++) sum[i] += factor * m.m[i / 3][i % 3];
}

/* Element by element: reads the stiffness in the order in which it lies in memory. */
static void dgfem_mvci_scatter_stiffness(const dgfem_mvc *body, const dgfem_mat3 *rotation, dgfem_real factor) {
    const dgfem_mvc_system *system = body->system;
    const dgfem_real *block = system->stiffness;
    const int *place = system->places;
    dgfem_matrix_clear(system->matrix);
    for (int e = 0; e < body->element_count; e++) {
        const int *nodes = system->nodes + system->node_start[e];
        int count = system->node_start[e + 1] - system->node_start[e];
        for (int a = 0; a < count; a++)
            for (int b = 0; b <= a; b++, block += 9, place++)
                dgfem_mvci_add_rotated(system->matrix->values + 9 * (size_t)*place, factor, &rotation[e], block,
                                       nodes[a] < nodes[b]);
    }
}

/* Block by block, each summed in the order of elements: threads do not meet, and bits are those of the above. */
static void dgfem_mvci_assemble_range(void *context, int first, int last) {
    const dgfem_mvci_pass *pass = (const dgfem_mvci_pass *)context;
    const dgfem_mvc_system *system = pass->body->system;
    for (int k = first; k < last; k++) {
        dgfem_real sum[9];
        memset(sum, 0, sizeof sum);
        for (int p = system->part_start[k]; p < system->part_start[k + 1]; p++) {
            const dgfem_mvci_block_part *part = &system->parts[p];
            dgfem_mvci_add_rotated(sum, pass->factor, &pass->rotation[part->element],
                                   system->stiffness + 9 * (size_t)part->pair, part->turned);
        }
        memcpy(system->matrix->values + 9 * (size_t)k, sum, sizeof sum);
    }
}

/* The matrix becomes factor * sum R K R^T. */
static void dgfem_mvci_assemble_stiffness(const dgfem_mvc *body, const dgfem_mat3 *rotation, dgfem_real factor) {
    const dgfem_matrix *matrix = body->system->matrix;
    dgfem_mvci_pass pass;
    memset(&pass, 0, sizeof pass);
    pass.body = body, pass.rotation = rotation, pass.factor = factor;
    if (!body->hooks.parallel_for) dgfem_mvci_scatter_stiffness(body, rotation, factor);
    else dgfem_mvci_run(&body->hooks, matrix->row_start[matrix->block_count], 64, dgfem_mvci_assemble_range, &pass);
}
