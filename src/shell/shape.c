#pragma once
#include "base.c"
/* Shape functions, quadrature points and sides of the two elements. */

/* Values and derivatives by the parameters (1, 2) of all shape functions at one point. */
typedef struct dgfem_shelli_basis {
    dgfem_real n[DGFEM_SHELL_MAX_NODES], d1[DGFEM_SHELL_MAX_NODES], d2[DGFEM_SHELL_MAX_NODES];
    dgfem_real d11[DGFEM_SHELL_MAX_NODES], d22[DGFEM_SHELL_MAX_NODES], d12[DGFEM_SHELL_MAX_NODES];
} dgfem_shelli_basis;

typedef struct dgfem_shelli_parameter {
    dgfem_real a, b;
} dgfem_shelli_parameter;

static dgfem_shelli_parameter dgfem_shelli_parameter_make(dgfem_real a, dgfem_real b) {
    dgfem_shelli_parameter p;
    p.a = a, p.b = b;
    return p;
}

/* Parameters of a corner. */
static dgfem_shelli_parameter dgfem_shelli_corner(int nodes, int corner) {
    static const signed char quad[4][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
    if (nodes == 8) return dgfem_shelli_parameter_make(quad[corner][0], quad[corner][1]);
    return dgfem_shelli_parameter_make(corner == 1, corner == 2);
}

static void dgfem_shelli_quad_basis(dgfem_real x, dgfem_real y, dgfem_shelli_basis *f) {
    const dgfem_real half = DGFEM_R(0.5), quarter = DGFEM_R(0.25);
    for (int i = 0; i < 4; i++) {
        dgfem_shelli_parameter c = dgfem_shelli_corner(8, i);
        dgfem_real u = x * c.a, v = y * c.b;
        f->n[i] = quarter * (1 + u) * (1 + v) * (u + v - 1);
        f->d1[i] = quarter * c.a * (1 + v) * (2 * u + v);
        f->d2[i] = quarter * c.b * (1 + u) * (u + 2 * v);
        f->d11[i] = half * (1 + v);
        f->d22[i] = half * (1 + u);
        f->d12[i] = quarter * c.a * c.b * (1 + 2 * u + 2 * v);
    }
    for (int i = 4; i < 8; i += 2) { /* middles of b = -1 and b = 1 */
        dgfem_real s = i == 4 ? DGFEM_R(-1) : DGFEM_R(1);
        f->n[i] = half * (1 - x * x) * (1 + s * y);
        f->d1[i] = -x * (1 + s * y);
        f->d2[i] = half * s * (1 - x * x);
        f->d11[i] = -(1 + s * y);
        f->d22[i] = 0;
        f->d12[i] = -s * x;
    }
    for (int i = 5; i < 8; i += 2) { /* middles of a = 1 and a = -1 */
        dgfem_real s = i == 5 ? DGFEM_R(1) : DGFEM_R(-1);
        f->n[i] = half * (1 - y * y) * (1 + s * x);
        f->d1[i] = half * s * (1 - y * y);
        f->d2[i] = -y * (1 + s * x);
        f->d11[i] = 0;
        f->d22[i] = -(1 + s * x);
        f->d12[i] = -s * y;
    }
}

static void dgfem_shelli_triangle_basis(dgfem_real x, dgfem_real y, dgfem_shelli_basis *f) {
    static const signed char d11[6] = {4, 4, 0, -8, 0, 0}, d22[6] = {4, 0, 4, 0, 0, -8}, d12[6] = {4, 0, 0, -4, 4, -4};
    dgfem_real z = 1 - x - y;
    f->n[0] = z * (2 * z - 1), f->d1[0] = f->d2[0] = 1 - 4 * z;
    f->n[1] = x * (2 * x - 1), f->d1[1] = 4 * x - 1, f->d2[1] = 0;
    f->n[2] = y * (2 * y - 1), f->d1[2] = 0, f->d2[2] = 4 * y - 1;
    f->n[3] = 4 * x * z, f->d1[3] = 4 * (z - x), f->d2[3] = -4 * x;
    f->n[4] = 4 * x * y, f->d1[4] = 4 * y, f->d2[4] = 4 * x;
    f->n[5] = 4 * y * z, f->d1[5] = -4 * y, f->d2[5] = 4 * (z - y);
    for (int i = 0; i < 6; i++) f->d11[i] = d11[i], f->d22[i] = d22[i], f->d12[i] = d12[i];
}

static void dgfem_shelli_basis_at(int nodes, dgfem_shelli_parameter p, dgfem_shelli_basis *f) {
    memset(f, 0, sizeof *f);
    if (nodes == 8) dgfem_shelli_quad_basis(p.a, p.b, f);
    else dgfem_shelli_triangle_basis(p.a, p.b, f);
}

/* Side `side` at s in [-1, 1], in the element's own direction. */
static dgfem_shelli_parameter dgfem_shelli_side(int nodes, int side, dgfem_real s) {
    dgfem_shelli_parameter p = dgfem_shelli_corner(nodes, side);
    dgfem_shelli_parameter q = dgfem_shelli_corner(nodes, (side + 1) % (nodes / 2));
    dgfem_real u = DGFEM_R(0.5) * (1 - s), v = DGFEM_R(0.5) * (1 + s);
    return dgfem_shelli_parameter_make(u * p.a + v * q.a, u * p.b + v * q.b);
}

/* ---- quadrature ---- */

enum { DGFEM_SHELLI_EDGE_POINTS = 3 };

/* Gauss-Legendre with three points on [-1, 1]. */
static dgfem_real dgfem_shelli_gauss_point(int q) { return (dgfem_real)((q - 1) * 0.77459666924148337704); }
static dgfem_real dgfem_shelli_gauss_weight(int q) { return (dgfem_real)(q == 1 ? 8.0 / 9 : 5.0 / 9); }

/* Points of the membrane and bending terms: 2 x 2 Gauss, for triangles 3 inside. More points lock. */
static int dgfem_shelli_point_count(int nodes) { return nodes == 8 ? 4 : 3; }

static dgfem_shelli_parameter dgfem_shelli_quadrature(int nodes, int q, dgfem_real *weight) {
    const dgfem_real g = (dgfem_real)0.57735026918962576451;
    *weight = nodes == 8 ? DGFEM_R(1) : (dgfem_real)(1.0 / 6);
    if (nodes == 8) return dgfem_shelli_parameter_make(q & 1 ? g : -g, q & 2 ? g : -g);
    return dgfem_shelli_parameter_make((dgfem_real)(q == 1 ? 2.0 / 3 : 1.0 / 6),
                                       (dgfem_real)(q == 2 ? 2.0 / 3 : 1.0 / 6));
}

/* Points for area, mass and loads: 3 x 3 Gauss, for triangles 7 of degree 5. */
static int dgfem_shelli_fine_count(int nodes) { return nodes == 8 ? 9 : 7; }

static dgfem_shelli_parameter dgfem_shelli_fine(int nodes, int q, dgfem_real *weight) {
    if (nodes == 8) {
        *weight = dgfem_shelli_gauss_weight(q % 3) * dgfem_shelli_gauss_weight(q / 3);
        return dgfem_shelli_parameter_make(dgfem_shelli_gauss_point(q % 3), dgfem_shelli_gauss_point(q / 3));
    }
    const double root = 3.87298334620741688518; /* sqrt(15) */
    int far = q > 3;
    double small = far ? (6 + root) / 21 : (6 - root) / 21, large = 1 - 2 * small;
    if (q == 0) {
        *weight = (dgfem_real)(9.0 / 80);
        return dgfem_shelli_parameter_make((dgfem_real)(1.0 / 3), (dgfem_real)(1.0 / 3));
    }
    *weight = (dgfem_real)(far ? (155 + root) / 2400 : (155 - root) / 2400);
    q = (q - 1) % 3;
    return dgfem_shelli_parameter_make((dgfem_real)(q == 1 ? large : small), (dgfem_real)(q == 2 ? large : small));
}

/* ---- geometry of a point of a curved element ---- */

typedef struct dgfem_shelli_frame {
    dgfem_vec3 e1, e2;        /* covariant base vectors */
    dgfem_vec3 e11, e22, e12; /* second derivatives */
    dgfem_vec3 c1, c2;        /* contravariant base vectors */
    dgfem_vec3 t;             /* unit normal */
    dgfem_real j;             /* area per parameter area */
} dgfem_shelli_frame;

static dgfem_vec3 dgfem_shelli_sum(const dgfem_real *n, const dgfem_vec3 *x, int count) {
    dgfem_vec3 sum = dgfem_shelli_scale(n[0], x[0]);
    for (int a = 1; a < count; a++) sum = dgfem_shelli_axpy(sum, n[a], x[a]);
    return sum;
}

/* x: the element's nodes. 0 where the surface has no tangent plane. */
static int dgfem_shelli_frame_at(const dgfem_shelli_basis *f, const dgfem_vec3 *x, int nodes, dgfem_shelli_frame *out) {
    out->e1 = dgfem_shelli_sum(f->d1, x, nodes);
    out->e2 = dgfem_shelli_sum(f->d2, x, nodes);
    out->e11 = dgfem_shelli_sum(f->d11, x, nodes);
    out->e22 = dgfem_shelli_sum(f->d22, x, nodes);
    out->e12 = dgfem_shelli_sum(f->d12, x, nodes);
    dgfem_vec3 n = dgfem_shelli_cross(out->e1, out->e2);
    dgfem_real g11 = dgfem_shelli_dot(out->e1, out->e1), g12 = dgfem_shelli_dot(out->e1, out->e2);
    dgfem_real g22 = dgfem_shelli_dot(out->e2, out->e2);
    out->j = dgfem_shelli_norm(n);
    if (!(out->j > DGFEM_R(1e-6) * (g11 + g22))) return 0;
    dgfem_real det = out->j * out->j;
    out->t = dgfem_shelli_scale(1 / out->j, n);
    out->c1 = dgfem_shelli_axpy(dgfem_shelli_scale(g22 / det, out->e1), -g12 / det, out->e2);
    out->c2 = dgfem_shelli_axpy(dgfem_shelli_scale(g11 / det, out->e2), -g12 / det, out->e1);
    return 1;
}
