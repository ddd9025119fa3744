#pragma once
#include "planar.c"
/* Integrals of all monomials over polyhedra and planar polygons, from signed tetrahedra and triangles.

   A closed surface, cut into triangles, with any apex o gives signed tetrahedra that add up to its interior, convex or
   not. The apex is a vertex, so that the faces around it drop out; the others are cut into fans:

       loop v0 v1 v2 v3 v4:              v3         a = v0, b = v1, c = v2, d = v3: the tetrahedra (o,a,b,c) and
                                        /| \        (o,a,c,d) are one pair; then b = v3, c = v4
                                      v4 |  v2
                                        \| /        o somewhere else, on other faces
                                         v0-v1

   A planar polygon with holes is the sum of signed triangles of an apex with the edges of its loops.

   Everything is relative, never in global coordinates: volumes come from differences to the apex, positions from
   differences to the centre. Those differences are the only place where an offset could cost digits, and they are exact
   or correctly rounded. They are divided by the power of two next to the caller's length scale, which is exact and
   keeps all powers within the range of float. */

DGFEM_API int dgfem_monomial_count(int degree) {
    return degree < 0 ? 0 : (degree + 1) * (degree + 2) * (degree + 3) / 6;
}

DGFEM_API int dgfem_monomial_index(int i, int j, int k) {
    return dgfem_monomial_count(i + j + k - 1) + (j + k) * (j + k + 1) / 2 + k;
}

/* ---- the recursion, several pairs of triangles side by side ---- */

/* Lanes fill 32 bytes: one AVX register, two of SSE or NEON. */
#define DGFEM_LANES ((int)(32 / sizeof(dgfem_real)))

static dgfem_real dgfemi_moments_lane_total(const dgfem_real *lanes) {
#if DGFEM_REAL_IS_FLOAT
    return ((lanes[0] + lanes[1]) + (lanes[2] + lanes[3])) + ((lanes[4] + lanes[5]) + (lanes[6] + lanes[7]));
#else
    return (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]);
#endif
}

#include "moments_generated.c"

#if DGFEM_MOMENTS_DEGREE < DGFEM_MAX_MOMENT_DEGREE
#error "dgfem: moments_generated.c was made for too low a degree"
#endif

/* ---- accumulation: begin, then the loops in any order, then end ---- */

static void dgfemi_moments_begin(dgfemi_moments *m, int degree, dgfem_vec3 centre, dgfem_real h) {
    int exponent;
    DGFEM_ASSERT(0 <= degree && degree <= DGFEM_MOMENTS_DEGREE && h > 0 && dgfemi_is_finite(h));
    (void)frexp((double)h, &exponent);
    m->degree = degree;
    m->centre = centre;
    m->scale = h;
    m->inverse_power = (dgfem_real)ldexp(1.0, -exponent);
    m->lanes = 0;
    m->face = 0;
    m->apex_vertex = m->waiting[0] = DGFEM_NONE;
    m->apex = dgfemi_vec3(0, 0, 0);
    memset(m->corner, 0, sizeof m->corner);
    memset(m->sum, 0, (size_t)dgfem_monomial_count(degree) * sizeof m->sum[0]);
}

/* Integrals of ((x - centre)/h)^(i,j,k), i + j + k <= degree, over the interior of a closed surface whose loops run
   counter-clockwise seen from outside. h > 0 of about the size of the object. All loops must follow before the end:
   sums over parts of a surface mean nothing. */
static void dgfemi_moments_begin_volume(dgfemi_moments *m, int degree, dgfem_vec3 centre, dgfem_real h) {
    dgfemi_moments_begin(m, degree, centre, h);
}

/* The same over a planar polygon whose loops run counter-clockwise about the unit normal. */
static void dgfemi_moments_begin_face(dgfemi_moments *m, int degree, dgfem_vec3 centre, dgfem_real h,
                                      dgfem_vec3 normal) {
    dgfemi_moments_begin(m, degree, centre, h);
    m->face = 1;
    m->normal = normal;
}

/* Results of (x - centre)^(i,j,k) instead; h then is only a hint. */
static void dgfemi_moments_unscaled(dgfemi_moments *m) { m->scale = 1; }

/* ---- weights: the volumes and areas of the simplices ---- */

#if !DGFEM_REAL_IS_FLOAT
/* a (b c' - b' c), a term of the determinant below, as result + *error. */
static double dgfemi_minor_term(double a, double b, double c1, double b1, double c, double *error) {
    double e1, e2, e3, e4;
    const double p = dgfemi_two_product(b, c1, &e1), q = dgfemi_two_product(b1, c, &e2);
    const double minor = dgfemi_two_sum(p, -q, &e3);
    const double term = dgfemi_two_product(a, minor, &e4);
    *error = e4 + a * (e3 + (e1 - e2));
    return term;
}
#endif

/* a.(b x c), as if computed with twice the digits. Flat elements that lie obliquely need it: with plain arithmetic the
   rounding errors, about 1e-16 |a| |b| |c|, could be as large as their volume. */
static dgfem_real dgfemi_triple_product(dgfem_vec3 a, dgfem_vec3 b, dgfem_vec3 c) {
#if DGFEM_REAL_IS_FLOAT
    const double ax = (double)a.x, ay = (double)a.y, az = (double)a.z, bx = (double)b.x, by = (double)b.y;
    const double bz = (double)b.z, cx = (double)c.x, cy = (double)c.y, cz = (double)c.z;
    return (dgfem_real)(ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx));
#else
    double ex, ey, ez, e1, e2, sum;
    const double x = dgfemi_minor_term(a.x, b.y, c.z, b.z, c.y, &ex);
    const double y = dgfemi_minor_term(a.y, b.z, c.x, b.x, c.z, &ey);
    const double z = dgfemi_minor_term(a.z, b.x, c.y, b.y, c.x, &ez);
    sum = dgfemi_two_sum(x, y, &e1);
    sum = dgfemi_two_sum(sum, z, &e2);
    return sum + ((e1 + e2) + (ex + ey + ez));
#endif
}

static dgfem_vec3 dgfemi_moments_corner(const dgfemi_moments *m, int corner, int l) {
    return dgfemi_vec3(m->corner[3 * corner][l], m->corner[3 * corner + 1][l], m->corner[3 * corner + 2][l]);
}

/* Six times the volumes of (o,a,b,c) and (o,a,c,d), o the origin of corner[]:
   a.(b x c) = -b.n and a.(c x d) = d.n with n = a x c.
   Where the terms of either sum (squared: size0, size1) exceed the sum itself by far, again with more digits. */
static void dgfemi_moments_volume_weights(dgfemi_moments *m) {
    const dgfem_real much = 64 * 64;
    dgfem_real doubt[DGFEM_LANES];
    int l;
    for (l = 0; l < DGFEM_LANES; l++) {
        const dgfem_real ax = m->corner[0][l], ay = m->corner[1][l], az = m->corner[2][l];
        const dgfem_real bx = m->corner[3][l], by = m->corner[4][l], bz = m->corner[5][l];
        const dgfem_real cx = m->corner[6][l], cy = m->corner[7][l], cz = m->corner[8][l];
        const dgfem_real dx = m->corner[9][l], dy = m->corner[10][l], dz = m->corner[11][l];
        const dgfem_real yz = ay * cz, zy = az * cy, zx = az * cx, xz = ax * cz, xy = ax * cy, yx = ay * cx;
        const dgfem_real nx = yz - zy, ny = zx - xz, nz = xy - yx;
        const dgfem_real w0 = -(bx * nx + by * ny + bz * nz), w1 = dx * nx + dy * ny + dz * nz;
        const dgfem_real sx = yz * yz + zy * zy, sy = zx * zx + xz * xz, sz = xy * xy + yx * yx;
        const dgfem_real size0 = bx * bx * sx + by * by * sy + bz * bz * sz;
        const dgfem_real size1 = dx * dx * sx + dy * dy * sy + dz * dz * sz;
        const dgfem_real doubt0 = size0 - much * w0 * w0, doubt1 = size1 - much * w1 * w1;
        m->weight[0][l] = w0;
        m->weight[1][l] = w1;
        doubt[l] = doubt0 > doubt1 ? doubt0 : doubt1;
    }
    for (l = 0; l < m->lanes; l++)
        if (doubt[l] > 0) {
            const dgfem_vec3 a = dgfemi_moments_corner(m, 0, l), c = dgfemi_moments_corner(m, 2, l);
            m->weight[0][l] = dgfemi_triple_product(a, dgfemi_moments_corner(m, 1, l), c);
            m->weight[1][l] = dgfemi_triple_product(a, c, dgfemi_moments_corner(m, 3, l));
        }
}

/* Twice the signed areas of (o,b,c) and (o,c,d). */
static void dgfemi_moments_face_weights(dgfemi_moments *m) {
    const dgfem_real nx = m->normal.x, ny = m->normal.y, nz = m->normal.z;
    int l;
    for (l = 0; l < DGFEM_LANES; l++) {
        const dgfem_real bx = m->corner[3][l], by = m->corner[4][l], bz = m->corner[5][l];
        const dgfem_real cx = m->corner[6][l], cy = m->corner[7][l], cz = m->corner[8][l];
        const dgfem_real dx = m->corner[9][l], dy = m->corner[10][l], dz = m->corner[11][l];
        m->weight[0][l] = nx * (by * cz - bz * cy) + ny * (bz * cx - bx * cz) + nz * (bx * cy - by * cx);
        m->weight[1][l] = nx * (cy * dz - cz * dy) + ny * (cz * dx - cx * dz) + nz * (cx * dy - cy * dx);
    }
}

/* Lanes that were not filled keep some earlier corners, or zeros; their weight must be zero. */
static void dgfemi_moments_flush(dgfemi_moments *m) {
    int n, l;
    if (m->face) dgfemi_moments_face_weights(m);
    else dgfemi_moments_volume_weights(m);
    for (l = m->lanes; l < DGFEM_LANES; l++) m->weight[0][l] = m->weight[1][l] = 0;
    for (n = 0; n < 12; n += 3)
        for (l = 0; l < DGFEM_LANES; l++) {
            m->corner[n][l] += m->apex.x;
            m->corner[n + 1][l] += m->apex.y;
            m->corner[n + 2][l] += m->apex.z;
        }
    dgfemi_moments_recursion(m);
    m->lanes = 0;
}

/* The vertex (DGFEM_NONE: the apex) as corner 0..3 of the pair in lane l, from the apex, scaled. */
static void dgfemi_moments_set_corner(dgfemi_moments *m, int corner, int l, int vertex) {
    dgfem_vec3 p = dgfemi_vec3(0, 0, 0);
    if (vertex != DGFEM_NONE) p = dgfemi_scale(m->inverse_power, dgfemi_sub(m->vertices[vertex], m->apex_position));
    m->corner[3 * corner][l] = p.x, m->corner[3 * corner + 1][l] = p.y, m->corner[3 * corner + 2][l] = p.z;
}

/* The triangles (a,b,c) and (a,c,d); d may be DGFEM_NONE, which gives the second no volume and no area. */
static void dgfemi_moments_push(dgfemi_moments *m, int a, int b, int c, int d) {
    const int l = m->lanes++;
    dgfemi_moments_set_corner(m, 0, l, a);
    dgfemi_moments_set_corner(m, 1, l, b);
    dgfemi_moments_set_corner(m, 2, l, c);
    dgfemi_moments_set_corner(m, 3, l, d);
    if (m->lanes == DGFEM_LANES) dgfemi_moments_flush(m);
}

/* A triangle without a neighbour in its loop, as all faces of a triangle mesh are: the last one waits for a triangle
   that shares an edge with it. */
static void dgfemi_moments_push_single(dgfemi_moments *m, int a, int b, int c) {
    int *w = m->waiting, t[3], i, k;
    t[0] = a, t[1] = b, t[2] = c;
    for (i = 0; i < 3 && w[0] != DGFEM_NONE; i++)
        for (k = 0; k < 3; k++)
            if (t[i] == w[(k + 1) % 3] && t[(i + 1) % 3] == w[k]) {
                dgfemi_moments_push(m, t[i], w[(k + 2) % 3], t[(i + 1) % 3], t[(i + 2) % 3]);
                w[0] = DGFEM_NONE;
                return;
            }
    if (w[0] != DGFEM_NONE) dgfemi_moments_push(m, w[0], w[1], w[2], DGFEM_NONE);
    w[0] = a, w[1] = b, w[2] = c;
}

/* The fan from a through the path loop[first], ..., loop[last - 1], where loop[count] means loop[0] again. */
static void dgfemi_moments_fan(dgfemi_moments *m, int a, const int *loop, int count, int first, int last, int reverse) {
    int i;
    for (i = first + 1; i < last; i += 2) {
        const int b = loop[i - 1], c = loop[i < count ? i : 0];
        if (i + 1 < last) {
            const int d = loop[i + 1 < count ? i + 1 : 0];
            dgfemi_moments_push(m, a, reverse ? d : b, c, reverse ? b : d);
        } else if (m->face) {
            dgfemi_moments_push(m, a, reverse ? c : b, reverse ? b : c, DGFEM_NONE);
        } else {
            dgfemi_moments_push_single(m, a, reverse ? c : b, reverse ? b : c);
        }
    }
}

/* One loop, planar, of vertex indices; reverse != 0 runs it backwards, as a face is seen from its other side. All loops
   between begin and end must index the same vertices. */
static void dgfemi_moments_loop(dgfemi_moments *m, const dgfem_vec3 *vertices, const int *loop, int count,
                                int reverse) {
    int i;
    if (count < 3) return;
    if (m->apex_vertex == DGFEM_NONE) {
        m->vertices = vertices;
        m->apex_vertex = loop[0];
        m->apex_position = vertices[loop[0]];
        m->apex = dgfemi_scale(m->inverse_power, dgfemi_sub(m->apex_position, m->centre));
    }
    DGFEM_ASSERT(m->vertices == vertices);
    if (m->face) {
        const int skip = loop[0] == m->apex_vertex; /* its two edges have no area */
        dgfemi_moments_fan(m, DGFEM_NONE, loop, count, skip, count + 1 - skip, reverse);
        return;
    }
    for (i = 0; i < count; i++)
        if (loop[i] == m->apex_vertex) return; /* a fan from the apex has no volume */
    dgfemi_moments_fan(m, loop[0], loop, count, 1, count, reverse);
}

/* out[dgfem_monomial_count(degree)], in the caller's scale h. */
static void dgfemi_moments_end(dgfemi_moments *m, dgfem_real *out) {
    const dgfem_real power = 1 / m->inverse_power, ratio = power / m->scale;
    if (m->waiting[0] != DGFEM_NONE) dgfemi_moments_push(m, m->waiting[0], m->waiting[1], m->waiting[2], DGFEM_NONE);
    if (m->lanes > 0) dgfemi_moments_flush(m);
    if (m->face) dgfemi_moments_finish(m, dgfemi_face_factors, power * power, ratio, out);
    else dgfemi_moments_finish(m, dgfemi_volume_factors, power * power * power, ratio, out);
}
