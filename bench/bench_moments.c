/* Moments of polyhedra: time per call and per triangle of the fans, beside the figures of r3d (init and recursion) and
   of the prototype of this scheme, both taken on another machine; and against quadrature on the same fan, here. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "shapes.h"

#include <stdio.h>
#include <time.h>

enum { DEGREE = 6, COUNT = 84, POINTS = 12, SHAPES = 5 };

static double seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* What is computed must be used. */
static volatile double sink;

/* ---- quadrature: the baseline ----

   All monomials at 12 points of each tetrahedron of centre and fan triangle, the 12 points side by side. The rule has
   fewer points than one that is exact for degree 6 (24). Where they lie does not change the time. */

typedef struct rule {
    dgfem_real barycentric[3][POINTS];
    dgfem_real weight[POINTS];
    int below[COUNT], axis[COUNT]; /* monomial n is monomial below[n] times a coordinate */
} rule;

static void rule_make(rule *r) {
    static const double orbit[3] = {0.05, 0.15, 0.3}; /* each: four points o, o, o, 1 - 3 o */
    int q, k, d, i, j, n = 1;
    for (q = 0; q < POINTS; q++) {
        for (k = 0; k < 3; k++) {
            const double o = orbit[q / 4];
            r->barycentric[k][q] = (dgfem_real)(q % 4 == k ? 1 - 3 * o : o);
        }
        r->weight[q] = (dgfem_real)(1.0 / POINTS);
    }
    for (d = 1; d <= DEGREE; d++)
        for (i = d; i >= 0; i--)
            for (j = d - i; j >= 0; j--, n++) {
                const int axis = i > 0 ? 0 : j > 0 ? 1 : 2;
                r->axis[n] = axis;
                r->below[n] = dgfem_monomial_index(i - (axis == 0), j - (axis == 1), d - i - j - (axis == 2));
            }
}

static void quadrature_tetrahedron(const rule *r, dgfem_vec3 a, dgfem_vec3 b, dgfem_vec3 c,
                                   dgfem_real sum[COUNT][POINTS]) {
    const dgfem_real volume = dgfemi_dot(a, dgfemi_cross(b, c)) / 6;
    dgfem_real point[3][POINTS], monomial[COUNT][POINTS];
    int n, q;
    for (q = 0; q < POINTS; q++) {
        const dgfem_real u = r->barycentric[0][q], v = r->barycentric[1][q], w = r->barycentric[2][q];
        point[0][q] = u * a.x + v * b.x + w * c.x;
        point[1][q] = u * a.y + v * b.y + w * c.y;
        point[2][q] = u * a.z + v * b.z + w * c.z;
        monomial[0][q] = r->weight[q] * volume;
        sum[0][q] += monomial[0][q];
    }
    for (n = 1; n < COUNT; n++) {
        const dgfem_real *below = monomial[r->below[n]], *coordinate = point[r->axis[n]];
        for (q = 0; q < POINTS; q++) {
            monomial[n][q] = below[q] * coordinate[q];
            sum[n][q] += monomial[n][q];
        }
    }
}

static void quadrature(const rule *r, const dgfem_polyhedron *p, dgfem_vec3 centre, dgfem_real *out) {
    dgfem_real sum[COUNT][POINTS];
    int l, i, n, q;
    memset(sum, 0, sizeof sum);
    for (l = 0; l < p->face_loops[p->face_count]; l++) {
        const int *loop = p->loop_vertices + p->loop_start[l], count = p->loop_start[l + 1] - p->loop_start[l];
        for (i = 2; i < count; i++)
            quadrature_tetrahedron(r, dgfemi_sub(p->vertices[loop[0]], centre),
                                   dgfemi_sub(p->vertices[loop[i - 1]], centre),
                                   dgfemi_sub(p->vertices[loop[i]], centre), sum);
    }
    for (n = 0; n < COUNT; n++) {
        out[n] = 0;
        for (q = 0; q < POINTS; q++) out[n] += sum[n][q];
    }
}

/* ---- timing: the fastest of many short runs, in nanoseconds per call ---- */

static double time_moments(const dgfem_polyhedron *p, int degree, dgfem_vec3 centre) {
    dgfem_real out[COUNT];
    double best = 1e30, end = seconds() + 0.1;
    while (seconds() < end) {
        const double start = seconds();
        double time;
        int k;
        for (k = 0; k < 20; k++) {
            (void)dgfem_polyhedron_moments(p, degree, centre, out);
            sink += (double)out[0];
        }
        time = (seconds() - start) / 20;
        if (time < best) best = time;
    }
    return 1e9 * best;
}

static double time_face_moments(const dgfem_polyhedron *p, int degree, dgfem_vec3 centre) {
    dgfem_real out[COUNT];
    double best = 1e30, end = seconds() + 0.05;
    while (seconds() < end) {
        const double start = seconds();
        double time;
        int f;
        for (f = 0; f < p->face_count; f++) {
            (void)dgfem_polyhedron_face_moments(p, f, degree, centre, out);
            sink += (double)out[0];
        }
        time = (seconds() - start) / p->face_count;
        if (time < best) best = time;
    }
    return 1e9 * best;
}

static double time_quadrature(const rule *r, const dgfem_polyhedron *p, dgfem_vec3 centre) {
    dgfem_real out[COUNT];
    double best = 1e30, end = seconds() + 0.2;
    while (seconds() < end) {
        const double start = seconds();
        double time;
        quadrature(r, p, centre, out);
        sink += (double)out[0];
        time = seconds() - start;
        if (time < best) best = time;
    }
    return 1e9 * best;
}

/* ---- the table ---- */

static const char *const names[SHAPES] = {"cube", "corner-cut cube", "truncated octahedron", "star prism", "torus"};
static const double r3d[SHAPES][3] = {
    {357, 1204, 2934}, {459, 1633, 4160}, {1237, 4345, 11350}, {1897, 6639, 15896}, {21629, 79141, 201090}};
static const double prototype[SHAPES][3] = {
    {98, 196, 360}, {121, 228, 469}, {285, 492, 1033}, {421, 694, 1495}, {1135, 1790, 3884}};

static shape s;

static dgfem_polyhedron *make(int kind) {
    if (kind == 0) shape_box(&s, 0, 0, 0, 2, 2, 2);
    if (kind == 1) shape_cut_cube(&s);
    if (kind == 2) shape_truncated_octahedron(&s);
    if (kind == 3) shape_star_prism(&s);
    if (kind == 4) shape_torus(&s, 10, 10);
    return shape_polyhedron(&s);
}

int main(void) {
    rule r;
    double cube = 0, points = 0;
    int kind, order;
    rule_make(&r);
    printf("moments about the centroid, ns per call (ns per fan triangle) [r3d, prototype of this scheme]\n");
    printf("%-21s %4s %4s %5s %34s %34s %34s\n", "shape", "vert", "face", "tris", "order 2", "order 4", "order 6");
    for (kind = 0; kind < SHAPES; kind++) {
        dgfem_polyhedron *p = make(kind);
        const dgfem_vec3 centre = dgfem_polyhedron_measure(p).centroid;
        const int triangles = s.corner_count - 2 * s.loop_count;
        printf("%-21s %4d %4d %5d", names[kind], s.vertex_count, s.face_count, triangles);
        for (order = 0; order < 3; order++) {
            const double time = time_moments(p, 2 * (order + 1), centre);
            printf(" %8.0f (%5.1f) [%6.0f, %5.0f]", time, time / triangles, r3d[kind][order], prototype[kind][order]);
            if (kind == 0) cube = time;
        }
        printf("\n");
        if (kind == 0) points = time_quadrature(&r, p, centre);
        dgfem_polyhedron_destroy(p);
    }
    printf("face moments, ns per face:\n");
    for (kind = 0; kind < SHAPES; kind++) {
        dgfem_polyhedron *p = make(kind);
        const dgfem_vec3 centre = dgfem_polyhedron_measure(p).centroid;
        printf("%-21s", names[kind]);
        for (order = 0; order < 3; order++)
            printf(" order %d: %6.0f", 2 * (order + 1), time_face_moments(p, 2 * (order + 1), centre));
        printf("\n");
        dgfem_polyhedron_destroy(p);
    }
    printf(
        "cube, all 84 moments: %.0f ns; 12-point quadrature of the same fan: %.0f ns, %.1f times as long (wanted: 5)\n",
        cube, points, points / cube);
    return 0;
}
