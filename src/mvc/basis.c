#pragma once
#include "base.c"
/* Mean value coordinates of polyhedra: values and gradients.

   Seen from x, a triangle with corners d_0, d_1, d_2 (relative to x, lengths r_i) fills a spherical triangle. The
   integral of its unit directions is, by Stokes' theorem, half the sum over its edges of angle times unit normal:

     m = 1/2 sum_e g_e C_e,    C_e = d_j x d_k,  g_e = theta_e / |C_e|      (edge e lies opposite corner e)

   Written as m = sum w_i d_i it gives each corner the weight w_i = (m . C_i) / D,  D = d_0 . C_0 = 6 times the volume
   of the tetrahedron over the triangle. Weights of a node add up over its triangles; phi_i = w_i / sum w. That is eq.
   (7) to (9), summed by triangles instead of by one-rings, and stays accurate in thin cells. Gradients are its
   derivatives:

     grad g    = g (d_j / r_j^2 + d_k / r_k^2) + h / (r_j r_k)^2 ((d_j + d_k) - cos (r_k / r_j d_j + r_j / r_k d_k)),
                 h = (sin - theta cos) / sin^3
     grad num_i = sum_e grad g_e (C_e . C_i) + g_e (v_e x C_i + v_i x C_e),    v_i = x_j - x_k,  num_i = 2 m . C_i
     grad D    = -N,   N = (x_1 - x_0) x (x_2 - x_0) */

/* Nearer to a plane than this times the size of the cell, a point counts as in it. */
#define DGFEM_MVCI_IN_PLANE (16 * DGFEM_MVC_EPSILON)
/* A triangle lower than this times its longest edge has no area. */
#define DGFEM_MVCI_FLAT (16 * DGFEM_MVC_EPSILON)

/* (sin t - t cos t) / sin^3 t; below t = 1/4 the difference would lose digits. */
static dgfem_real dgfem_mvci_angle_term(dgfem_real t, dgfem_real cosine, dgfem_real sine) {
    dgfem_real s = t * t, sum = DGFEM_R(4.0 / 200475);
    if (t > DGFEM_R(0.25)) return (sine - t * cosine) / (sine * sine * sine);
    sum = DGFEM_R(2764.0 / 19348875) + s * sum;
    sum = DGFEM_R(2.0 / 2079) + s * sum;
    sum = DGFEM_R(4.0 / 675) + s * sum;
    sum = DGFEM_R(2.0 / 63) + s * sum;
    sum = DGFEM_R(2.0 / 15) + s * sum;
    return DGFEM_R(1.0 / 3) + s * sum;
}

/* g = theta / |a x b| of an edge from a to b, of lengths ra and rb, seen from the origin, and its derivative by a
   motion of the viewer. */
static dgfem_real dgfem_mvci_edge_weight(dgfem_vec3 a, dgfem_vec3 b, dgfem_real ra, dgfem_real rb, dgfem_vec3 cross,
                                         dgfem_vec3 *gradient) {
    dgfem_real rr = ra * rb, s = dgfem_mvci_norm(cross), c = dgfem_mvci_dot(a, b);
    dgfem_real sine = s / rr, cosine = c / rr, angle = (dgfem_real)atan2((double)s, (double)c);
    dgfem_real g = (angle < DGFEM_R(1e-4) ? 1 + angle * angle / 6 : angle / sine) / rr;
    if (!gradient) return g;
    dgfem_real h = dgfem_mvci_angle_term(angle, cosine, sine) / (rr * rr);
    *gradient =
        dgfem_mvci_blend(g / (ra * ra) + h * (1 - cosine * rb / ra), a, g / (rb * rb) + h * (1 - cosine * ra / rb), b);
    return g;
}

/* Weights w_i of a triangle's corners d, and their gradients (or NULL). Products of two edges serve both of their
   corners. */
static void dgfem_mvci_triangle_weights(const dgfem_vec3 *d, dgfem_vec3 normal, dgfem_real volume, dgfem_real *w,
                                        dgfem_vec3 *gradients) {
    dgfem_vec3 cross[3], v[3], edge_gradient[3];
    dgfem_real g[3], r[3], half = 1 / (2 * volume);
    for (int i = 0; i < 3; i++) r[i] = dgfem_mvci_norm(d[i]);
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        cross[i] = dgfem_mvci_cross(d[j], d[k]);
        v[i] = dgfem_mvci_sub(d[j], d[k]);
        g[i] = dgfem_mvci_edge_weight(d[j], d[k], r[j], r[k], cross[i], gradients ? &edge_gradient[i] : NULL);
        w[i] = 0;
        if (gradients) gradients[i] = dgfem_mvci_vec3(0, 0, 0);
    }
    for (int i = 0; i < 3; i++)
        for (int e = 0; e <= i; e++) {
            dgfem_real product = dgfem_mvci_dot(cross[e], cross[i]);
            w[i] += half * g[e] * product;
            if (e < i) w[e] += half * g[i] * product;
            if (!gradients) continue;
            dgfem_vec3 turn = dgfem_mvci_add(dgfem_mvci_cross(v[e], cross[i]), dgfem_mvci_cross(v[i], cross[e]));
            dgfem_vec3 *to = &gradients[i];
            *to = dgfem_mvci_add(*to, dgfem_mvci_blend(half * product, edge_gradient[e], half * g[e], turn));
            to = &gradients[e];
            if (e < i) *to = dgfem_mvci_add(*to, dgfem_mvci_blend(half * product, edge_gradient[i], half * g[i], turn));
        }
    for (int i = 0; gradients && i < 3; i++) gradients[i] = dgfem_mvci_axpy(gradients[i], 2 * half * w[i], normal);
}

/* Whether the origin, which is in the triangle's plane, is in the triangle: then b are its barycentric coordinates. */
static int dgfem_mvci_in_triangle(const dgfem_vec3 *d, dgfem_vec3 normal, dgfem_real *b) {
    dgfem_real area = dgfem_mvci_norm(normal), sum = 0;
    for (int i = 0; i < 3; i++) {
        dgfem_vec3 from = d[(i + 1) % 3], to = d[(i + 2) % 3];
        b[i] = dgfem_mvci_dot(normal, dgfem_mvci_cross(from, to)) / (area * area);
        dgfem_real distance = b[i] * area / dgfem_mvci_norm(dgfem_mvci_sub(to, from));
        if (!(distance >= -DGFEM_MVCI_IN_PLANE)) return 0;
        b[i] = dgfem_mvci_max(b[i], 0);
        sum += b[i];
    }
    for (int i = 0; i < 3; i++) b[i] /= sum;
    return 1;
}

/* One triangle as x sees it, scaled. */
typedef struct dgfem_mvci_view {
    dgfem_vec3 corner[3]; /* relative to x */
    dgfem_vec3 normal;    /* twice the area long */
    dgfem_real volume;    /* six times that of the tetrahedron over the triangle */
    int flat;             /* has no area */
    int in_plane;         /* x is in its plane */
} dgfem_mvci_view;

static dgfem_mvci_view dgfem_mvci_look(const dgfem_vec3 *nodes, const int *triangle, dgfem_vec3 x, dgfem_real scale) {
    dgfem_mvci_view view;
    dgfem_vec3 edge[3];
    dgfem_real longest = 0, nearest = -1;
    int base = 0;
    for (int i = 0; i < 3; i++) {
        edge[i] = dgfem_mvci_sub(nodes[triangle[(i + 1) % 3]], nodes[triangle[i]]);
        edge[i] = dgfem_mvci_scale(scale, edge[i]);
        view.corner[i] = dgfem_mvci_scale(scale, dgfem_mvci_sub(nodes[triangle[i]], x));
        dgfem_real r = dgfem_mvci_dot(view.corner[i], view.corner[i]);
        if (nearest < 0 || r < nearest) nearest = r, base = i;
        longest = dgfem_mvci_max(longest, dgfem_mvci_dot(edge[i], edge[i]));
    }
    view.normal = dgfem_mvci_cross(edge[0], edge[1]);
    view.volume = dgfem_mvci_dot(view.corner[base], view.normal);
    dgfem_real area = dgfem_mvci_norm(view.normal);
    view.flat = !(area > DGFEM_MVCI_FLAT * longest);
    view.in_plane = dgfem_mvci_abs(view.volume) <= DGFEM_MVCI_IN_PLANE * area;
    return view;
}

/* Values phi[count] of a closed triangulated cell at x, and gradients (or NULL). Returns 1, or 0 where x lies on the
   surface: then phi is linear on the triangle and gradients mean nothing. Triangles without area, and those whose plane
   passes through x, have no weight. */
static int dgfem_mvci_basis(const dgfem_vec3 *nodes, int count, const int *triangles, int triangle_count, dgfem_vec3 x,
                            dgfem_real *phi, dgfem_vec3 *gradients) {
    dgfem_real size = 0, sum = 0;
    dgfem_vec3 slope = dgfem_mvci_vec3(0, 0, 0);
    for (int i = 0; i < count; i++) {
        size = dgfem_mvci_max(size, dgfem_mvci_norm(dgfem_mvci_sub(nodes[i], x)));
        phi[i] = 0;
        if (gradients) gradients[i] = slope;
    }
    for (int t = 0; t < triangle_count; t++) {
        const int *at = triangles + 3 * t;
        dgfem_mvci_view view = dgfem_mvci_look(nodes, at, x, 1 / size);
        dgfem_real w[3];
        dgfem_vec3 dw[3];
        if (view.flat) continue;
        if (view.in_plane) {
            if (!dgfem_mvci_in_triangle(view.corner, view.normal, w)) continue;
            for (int i = 0; i < count; i++) phi[i] = 0;
            for (int i = 0; i < 3; i++) phi[at[i]] = w[i];
            return 0;
        }
        dgfem_mvci_triangle_weights(view.corner, view.normal, view.volume, w, gradients ? dw : NULL);
        for (int i = 0; i < 3; i++) {
            phi[at[i]] += w[i];
            sum += w[i];
            if (!gradients) continue;
            gradients[at[i]] = dgfem_mvci_add(gradients[at[i]], dw[i]);
            slope = dgfem_mvci_add(slope, dw[i]);
        }
    }
    for (int i = 0; i < count; i++) {
        phi[i] /= sum;
        if (gradients) gradients[i] = dgfem_mvci_scale(1 / (sum * size), dgfem_mvci_axpy(gradients[i], -phi[i], slope));
    }
    return 1;
}

/* ---- public ---- */

/* Closed surfaces have no vector area: a cheap necessary condition. */
static dgfem_status dgfem_mvci_check_cell(const dgfem_mvc_cell *cell) {
    dgfem_vec3 sum = dgfem_mvci_vec3(0, 0, 0);
    dgfem_real whole = 0;
    if (cell->node_count < 4 || cell->triangle_count < 4 || !cell->nodes || !cell->triangles)
        return DGFEM_ERROR_ARGUMENT;
    for (int i = 0; i < cell->node_count; i++)
        if (!dgfem_mvci_is_finite3(cell->nodes[i])) return DGFEM_ERROR_NOT_FINITE;
    for (int t = 0; t < cell->triangle_count; t++) {
        const int *at = cell->triangles + 3 * t;
        for (int i = 0; i < 3; i++)
            if (at[i] < 0 || at[i] >= cell->node_count) return DGFEM_ERROR_INDEX;
        dgfem_vec3 normal = dgfem_mvci_cross(dgfem_mvci_sub(cell->nodes[at[1]], cell->nodes[at[0]]),
                                             dgfem_mvci_sub(cell->nodes[at[2]], cell->nodes[at[0]]));
        sum = dgfem_mvci_add(sum, normal);
        whole += dgfem_mvci_norm(normal);
    }
    if (!(whole > 0)) return DGFEM_ERROR_DEGENERATE;
    return dgfem_mvci_norm(sum) <= DGFEM_R(1e-4) * whole ? DGFEM_OK : DGFEM_ERROR_OPEN;
}

DGFEM_API dgfem_status dgfem_mvc_coordinates(const dgfem_mvc_cell *cell, dgfem_vec3 x, dgfem_real *values,
                                             dgfem_vec3 *gradients) {
    if (!cell || !values) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_check_cell(cell);
    if (status) return status;
    if (!dgfem_mvci_is_finite3(x)) return DGFEM_ERROR_NOT_FINITE;
    int inside =
        dgfem_mvci_basis(cell->nodes, cell->node_count, cell->triangles, cell->triangle_count, x, values, gradients);
    for (int i = 0; i < cell->node_count; i++)
        if (!dgfem_mvci_is_finite(values[i])) return DGFEM_ERROR_DEGENERATE;
    return inside || !gradients ? DGFEM_OK : DGFEM_ERROR_DEGENERATE;
}
