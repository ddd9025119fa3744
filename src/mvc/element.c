#pragma once
#include "mesh.c"
/* Integrals of one element: volume fractions, mean gradients, stiffness.

   Elements are star-shaped about their volume centroid c: each triangle f of their faces has a tetrahedron (f, c) of
   positive volume v_f. With kappa_f = v_f / V and mu_i = sum of v_f / (3 V) over the triangles of node i, masses mu_i
   rho V have the element's mass and centre of mass, eq. (18).

   Basis functions are linear on triangles, so that the divergence theorem gives the integral of a gradient exactly:
     V <grad phi_i> = sum over triangles (a, b, c) of node i of (x_b - x_a) x (x_c - x_a) / 6
   The corrected rules shift all samples of grad phi_i by one vector so that their sum agrees with it. Then stresses of
   linear fields are in balance across elements, which sampling alone spoils. */

/* An element while it is integrated. */
typedef struct dgfem_mvci_shape {
    int node_count, triangle_count;
    const int *nodes; /* [node_count] of the mesh */
    int *triangles;   /* indices of `nodes` */
    dgfem_vec3 *x;    /* [node_count] at rest */
    dgfem_vec3 centre;
    dgfem_real volume;
    dgfem_real *kappa; /* [triangle_count] */
    dgfem_real *mu;    /* [node_count] */
    dgfem_vec3 *mean;  /* [node_count] <grad phi_i> */
    int point_count;
    dgfem_real *phi;      /* [node_count] */
    dgfem_real *weight;   /* [points] sum to the volume */
    dgfem_vec3 *gradient; /* [points * node_count] */
    dgfem_real *basis;    /* [4 * node_count] orthonormal: 1, x, y, z at the nodes */
} dgfem_mvci_shape;

static int dgfem_mvci_point_count(dgfem_mvc_quadrature quadrature, int nodes, int triangles) {
    if (nodes == 4) return 1;
    return quadrature == DGFEM_MVC_TET4 ? 4 * triangles : nodes + triangles;
}

/* ---- measures ---- */

/* Volume fractions and mean gradients about the volume centroid. Returns the first triangle that does not see it from
   inside, or DGFEM_NONE. */
static int dgfem_mvci_measure_shape(dgfem_mvci_shape *shape) {
    memset(shape->mu, 0, (size_t)shape->node_count * sizeof *shape->mu);
    memset(shape->mean, 0, (size_t)shape->node_count * sizeof *shape->mean);
    for (int t = 0; t < shape->triangle_count; t++) {
        const int *at = shape->triangles + 3 * t;
        dgfem_vec3 origin = shape->x[at[0]];
        dgfem_vec3 normal =
            dgfem_mvci_cross(dgfem_mvci_sub(shape->x[at[1]], origin), dgfem_mvci_sub(shape->x[at[2]], origin));
        dgfem_real v = dgfem_mvci_dot(dgfem_mvci_sub(origin, shape->centre), normal) / 6;
        if (!(v > 0)) return t;
        shape->kappa[t] = v / shape->volume;
        for (int i = 0; i < 3; i++) {
            shape->mu[at[i]] += v / (3 * shape->volume);
            shape->mean[at[i]] = dgfem_mvci_axpy(shape->mean[at[i]], 1 / (6 * shape->volume), normal);
        }
    }
    return DGFEM_NONE;
}

/* ---- samples of gradients ---- */

static int dgfem_mvci_sample(dgfem_mvci_shape *shape, dgfem_vec3 x, dgfem_real weight) {
    dgfem_vec3 *gradient = shape->gradient + (size_t)shape->point_count * (size_t)shape->node_count;
    shape->weight[shape->point_count++] = weight;
    return dgfem_mvci_basis(shape->x, shape->node_count, shape->triangles, shape->triangle_count, x, shape->phi,
                            gradient);
}

static dgfem_vec3 dgfem_mvci_triangle_centre(const dgfem_mvci_shape *shape, int t) {
    const int *at = shape->triangles + 3 * t;
    dgfem_vec3 sum = dgfem_mvci_add(dgfem_mvci_add(shape->x[at[0]], shape->x[at[1]]), shape->x[at[2]]);
    return dgfem_mvci_scale(DGFEM_R(1.0 / 3), sum);
}

/* The four-point rule of degree 2 in each tetrahedron (f, c). */
static int dgfem_mvci_sample_tetrahedra(dgfem_mvci_shape *shape) {
    const dgfem_real near = DGFEM_R(0.5854101966249685), far = DGFEM_R(0.1381966011250105);
    int ok = 1;
    for (int t = 0; t < shape->triangle_count && ok; t++) {
        const int *at = shape->triangles + 3 * t;
        dgfem_real weight = shape->kappa[t] * shape->volume / 4;
        dgfem_vec3 sum = dgfem_mvci_scale(far, shape->centre);
        for (int i = 0; i < 3; i++) sum = dgfem_mvci_axpy(sum, far, shape->x[at[i]]);
        ok = dgfem_mvci_sample(shape, dgfem_mvci_axpy(sum, near - far, shape->centre), weight);
        for (int i = 0; i < 3 && ok; i++)
            ok = dgfem_mvci_sample(shape, dgfem_mvci_axpy(sum, near - far, shape->x[at[i]]), weight);
    }
    return ok;
}

/* Eq. (14) to (16), with the factor V_e that (16) lacks. */
static int dgfem_mvci_sample_paper(dgfem_mvci_shape *shape) {
    const dgfem_real half = shape->volume / 2;
    int ok = 1;
    for (int i = 0; i < shape->node_count && ok; i++)
        ok = dgfem_mvci_sample(shape, dgfem_mvci_blend(DGFEM_R(0.8), shape->x[i], DGFEM_R(0.2), shape->centre),
                               shape->mu[i] * half);
    for (int t = 0; t < shape->triangle_count && ok; t++) {
        dgfem_vec3 middle = dgfem_mvci_triangle_centre(shape, t);
        ok = dgfem_mvci_sample(shape, dgfem_mvci_blend(DGFEM_R(0.9), middle, DGFEM_R(0.1), shape->centre),
                               shape->kappa[t] * half);
    }
    return ok;
}

/* Makes the weighted mean of each node's samples its mean gradient. */
static void dgfem_mvci_correct(dgfem_mvci_shape *shape) {
    for (int i = 0; i < shape->node_count; i++) {
        dgfem_vec3 sum = dgfem_mvci_vec3(0, 0, 0), *gradient = shape->gradient + i;
        for (int q = 0; q < shape->point_count; q++)
            sum = dgfem_mvci_axpy(sum, shape->weight[q] / shape->volume, gradient[q * shape->node_count]);
        dgfem_vec3 shift = dgfem_mvci_sub(shape->mean[i], sum);
        for (int q = 0; q < shape->point_count; q++)
            gradient[q * shape->node_count] = dgfem_mvci_add(gradient[q * shape->node_count], shift);
    }
}

/* 0 where a sample falls on the surface: the element is degenerate. On tetrahedra gradients are constant. */
static int dgfem_mvci_sample_shape(dgfem_mvci_shape *shape, dgfem_mvc_quadrature quadrature) {
    shape->point_count = 0;
    if (shape->node_count == 4) {
        memcpy(shape->gradient, shape->mean, 4 * sizeof *shape->mean);
        shape->weight[shape->point_count++] = shape->volume;
        return 1;
    }
    int ok = quadrature == DGFEM_MVC_TET4 ? dgfem_mvci_sample_tetrahedra(shape) : dgfem_mvci_sample_paper(shape);
    if (ok && quadrature != DGFEM_MVC_PAPER_RAW) dgfem_mvci_correct(shape);
    return ok;
}

/* ---- stiffness ---- */

/* Lame's constants. */
static dgfem_real dgfem_mvci_shear(dgfem_material m) { return m.young / (2 * (1 + m.poisson)); }
static dgfem_real dgfem_mvci_lambda(dgfem_material m) {
    return m.young * m.poisson / ((1 + m.poisson) * (1 - 2 * m.poisson));
}

/* block += s u v^T, row-major. */
static void dgfem_mvci_add_block(dgfem_real *block, dgfem_real s, dgfem_vec3 u, dgfem_vec3 v) {
    dgfem_vec3 w = dgfem_mvci_scale(s, u);
    block[0] += w.x * v.x, block[1] += w.x * v.y, block[2] += w.x * v.z;
    block[3] += w.y * v.x, block[4] += w.y * v.y, block[5] += w.y * v.z;
    block[6] += w.z * v.x, block[7] += w.z * v.y, block[8] += w.z * v.z;
}

/* From A = integral of g_a g_b^T:  c A + mu (A^T + tr A I). c = lambda gives the stiffness; c = -2/3 mu that of the
   strain's deviator alone. */
static void dgfem_mvci_elastic_block(dgfem_real *block, dgfem_real c, dgfem_real mu) {
    dgfem_real a[9], trace = mu * (block[0] + block[4] + block[8]);
    memcpy(a, block, sizeof a);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) block[3 * i + j] = c * a[3 * i + j] + mu * a[3 * j + i];
    for (int i = 0; i < 9; i += 4) block[i] += trace;
}

/* Stiffness of a sampled shape: blocks (a, b), b <= a, one after the other. With b_bar the change of volume at each
   point is its mean in the element. */
static void dgfem_mvci_stiffness(const dgfem_mvci_shape *shape, dgfem_material material, int b_bar, dgfem_real *out) {
    dgfem_real mu = dgfem_mvci_shear(material), lambda = dgfem_mvci_lambda(material);
    dgfem_real bulk = b_bar ? lambda + 2 * mu / 3 : 0, c = b_bar ? -2 * mu / 3 : lambda;
    int n = shape->node_count;
    memset(out, 0, (size_t)n * ((size_t)n + 1) / 2 * 9 * sizeof *out);
    for (int q = 0; q < shape->point_count; q++) {
        const dgfem_vec3 *g = shape->gradient + (size_t)q * (size_t)n;
        dgfem_real *block = out;
        for (int a = 0; a < n; a++)
            for (int b = 0; b <= a; b++, block += 9) dgfem_mvci_add_block(block, shape->weight[q], g[a], g[b]);
    }
    for (int a = 0; a < n; a++)
        for (int b = 0; b <= a; b++, out += 9) {
            dgfem_mvci_elastic_block(out, c, mu);
            if (b_bar) dgfem_mvci_add_block(out, bulk * shape->volume, shape->mean[a], shape->mean[b]);
        }
}

/* Orthonormal vectors that span 1, x, y, z at the nodes. Gram-Schmidt, twice for round-off. */
static void dgfem_mvci_linear_span(dgfem_mvci_shape *shape) {
    int n = shape->node_count;
    for (int i = 0; i < n; i++) {
        dgfem_vec3 d = dgfem_mvci_sub(shape->x[i], shape->centre);
        shape->basis[i] = 1, shape->basis[n + i] = d.x, shape->basis[2 * n + i] = d.y, shape->basis[3 * n + i] = d.z;
    }
    for (int k = 0; k < 8; k++) {
        dgfem_real *v = shape->basis + (k / 2) * n, square = 0;
        for (const dgfem_real *u = shape->basis; u < v; u += n) {
            dgfem_real s = 0;
            for (int i = 0; i < n; i++) s += u[i] * v[i];
            for (int i = 0; i < n; i++) v[i] -= s * u[i];
        }
        for (int i = 0; i < n; i++) square += v[i] * v[i];
        for (int i = 0; i < n; i++) v[i] /= dgfem_mvci_sqrt(square);
    }
}

/* Adds factor (1 - Pi) (x) I, Pi the projection of nodal values to linear fields. */
static void dgfem_mvci_stabilise(dgfem_mvci_shape *shape, dgfem_real factor, dgfem_real *out) {
    int n = shape->node_count;
    if (n == 4) return;
    dgfem_mvci_linear_span(shape);
    for (int a = 0; a < n; a++)
        for (int b = 0; b <= a; b++, out += 9) {
            dgfem_real s = (dgfem_real)(a == b);
            for (int k = 0; k < 4; k++) s -= shape->basis[k * n + a] * shape->basis[k * n + b];
            for (int i = 0; i < 9; i += 4) out[i] += factor * s;
        }
}
