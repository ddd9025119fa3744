/* The stand-alone polyhedron: creation, check, measure, contains, triangles of faces, components; the exact predicates
   behind them. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check.h"
#include "shapes.h"

#include <gmp.h>

static shape s, scratch;

static const double tight = 16 * CHECK_EPSILON;

/* ---- creation ---- */

static dgfem_status try_create(const dgfem_polyhedron_desc *desc, check_host *host) {
    dgfem_polyhedron_desc copy = *desc;
    dgfem_polyhedron *polyhedron = (dgfem_polyhedron *)host;
    dgfem_status status;
    copy.hooks = check_hooks(host);
    status = dgfem_polyhedron_create(&copy, &polyhedron);
    if (status) assert_null(polyhedron);
    dgfem_polyhedron_destroy(polyhedron);
    assert_int_equal(host->live, 0);
    return status;
}

static void creation_copies(void **state) {
    dgfem_polyhedron *p;
    (void)state;
    shape_plate(&s);
    p = shape_polyhedron(&s);
    assert_int_equal(p->vertex_count, 24);
    assert_int_equal(p->face_count, 14);
    assert_memory_equal(p->vertices, s.vertices, 24 * sizeof *p->vertices);
    assert_memory_equal(p->face_loops, s.face_loops, 15 * sizeof(int));
    assert_memory_equal(p->loop_start, s.loop_start, (size_t)(s.loop_count + 1) * sizeof(int));
    assert_memory_equal(p->loop_vertices, s.loop_vertices, (size_t)s.corner_count * sizeof(int));
    dgfem_polyhedron_destroy(p);
    dgfem_polyhedron_destroy(NULL);
}

static void creation_without_face_loops(void **state) {
    dgfem_polyhedron_desc desc;
    dgfem_polyhedron *p;
    int f;
    (void)state;
    shape_box(&s, 0, 0, 0, 1, 2, 3);
    desc = shape_desc(&s);
    desc.face_loops = NULL;
    check_status(dgfem_polyhedron_create(&desc, &p), DGFEM_OK);
    for (f = 0; f <= 6; f++) assert_int_equal(p->face_loops[f], f);
    check_status(dgfem_polyhedron_check(p, 0), DGFEM_OK);
    dgfem_polyhedron_destroy(p);
}

static void creation_refuses_bad_input(void **state) {
    dgfem_polyhedron_desc good, desc;
    check_host host;
    (void)state;
    shape_box(&s, 0, 0, 0, 1, 1, 1);
    good = shape_desc(&s);
    check_status(dgfem_polyhedron_create(NULL, NULL), DGFEM_ERROR_DESCRIPTOR);
    memset(&desc, 0, sizeof desc);
    check_status(try_create(&desc, &host), DGFEM_ERROR_DESCRIPTOR);
    assert_int_equal(host.log_count, 0); /* hooks of an uninitialised descriptor must not be called */
    desc = good, desc.hooks = check_hooks(&host);
    check_status(dgfem_polyhedron_create(&desc, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "nowhere");
    desc = good, desc.vertex_count = -1;
    check_status(try_create(&desc, &host), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "negative");
    desc = good, desc.face_count = 0;
    check_status(try_create(&desc, &host), DGFEM_ERROR_EMPTY);
    check_logged(&host, "0 faces");
    desc = good, desc.vertex_count = 0;
    check_status(try_create(&desc, &host), DGFEM_ERROR_EMPTY);
    check_logged(&host, "0 vertices");
    desc = good, desc.vertices = NULL;
    check_status(try_create(&desc, &host), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "NULL");
    desc = good, desc.loop_start = NULL;
    check_status(try_create(&desc, &host), DGFEM_ERROR_ARGUMENT);
    desc = good, desc.loop_vertices = NULL;
    check_status(try_create(&desc, &host), DGFEM_ERROR_ARGUMENT);
    s.vertices[5].y = (dgfem_real)NAN;
    check_status(try_create(&good, &host), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "vertex 5");
    s.vertices[5].y = (dgfem_real)INFINITY;
    check_status(try_create(&good, &host), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "vertex 5");
}

static void creation_refuses_bad_loops(void **state) {
    dgfem_polyhedron_desc desc;
    check_host host;
    (void)state;
    shape_box(&s, 0, 0, 0, 1, 1, 1);
    desc = shape_desc(&s);
    s.loop_vertices[6] = 8;
    check_status(try_create(&desc, &host), DGFEM_ERROR_INDEX);
    check_logged(&host, "loop 1 has vertex 8 of 8");
    s.loop_vertices[6] = -1;
    check_status(try_create(&desc, &host), DGFEM_ERROR_INDEX);
    check_logged(&host, "vertex -1");
    s.loop_vertices[6] = s.loop_vertices[5];
    check_status(try_create(&desc, &host), DGFEM_ERROR_DEGENERATE);
    check_logged(&host, "twice in a row");
    shape_box(&s, 0, 0, 0, 1, 1, 1);
    s.loop_vertices[11] = s.loop_vertices[8]; /* last and first of a loop are neighbours too */
    check_status(try_create(&desc, &host), DGFEM_ERROR_DEGENERATE);
    check_logged(&host, "loop 2");
    shape_box(&s, 0, 0, 0, 1, 1, 1);
    s.loop_start[1] = 2;
    check_status(try_create(&desc, &host), DGFEM_ERROR_DEGENERATE);
    check_logged(&host, "loop 0 has 2 vertices");
    s.loop_start[1] = 9;
    check_status(try_create(&desc, &host), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "loop 1");
    s.loop_start[1] = 4, s.loop_start[0] = -4;
    check_status(try_create(&desc, &host), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "starts with -4");
    s.loop_start[0] = 0, s.face_loops[2] = s.face_loops[1];
    check_status(try_create(&desc, &host), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "face 1 has no loop");
    s.face_loops[2] = 2, s.face_loops[0] = 1;
    check_status(try_create(&desc, &host), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "face_loops starts with 1");
}

static dgfem_status run_everything(void *context, const dgfem_hooks *hooks) {
    dgfem_polyhedron_desc desc = shape_desc((const shape *)context);
    dgfem_polyhedron *p = NULL, *part = NULL;
    dgfem_status status;
    int triangles[96], count;
    desc.hooks = *hooks;
    status = dgfem_polyhedron_create(&desc, &p);
    if (status) return status;
    status = dgfem_polyhedron_check(p, 0);
    if (!status) status = dgfem_polyhedron_triangulate_face(p, 1, triangles, 32, &count);
    if (!status) status = dgfem_polyhedron_component_count(p, &count);
    if (!status) status = dgfem_polyhedron_component(p, 0, &part);
    dgfem_polyhedron_destroy(part);
    dgfem_polyhedron_destroy(p);
    return status;
}

static void every_allocation_may_fail(void **state) {
    (void)state;
    shape_plate(&s);
    assert_true(check_every_allocation(run_everything, &s) >= 10);
}

/* ---- check ---- */

static dgfem_status try_check(const shape *solid, dgfem_real tolerance, check_host *host) {
    dgfem_polyhedron_desc desc = shape_desc(solid);
    dgfem_polyhedron *p;
    dgfem_status status;
    desc.hooks = check_hooks(host);
    check_status(dgfem_polyhedron_create(&desc, &p), DGFEM_OK);
    status = dgfem_polyhedron_check(p, tolerance);
    dgfem_polyhedron_destroy(p);
    assert_int_equal(host->live, 0);
    return status;
}

static void good_polyhedra_pass(void **state) {
    check_host host;
    (void)state;
    shape_tetrahedron(&s);
    check_status(try_check(&s, 0, &host), DGFEM_OK);
    shape_cut_cube(&s);
    check_status(try_check(&s, 0, &host), DGFEM_OK);
    shape_truncated_octahedron(&s);
    assert_int_equal(s.vertex_count, 24);
    assert_int_equal(s.face_count, 14);
    check_status(try_check(&s, DGFEM_R(8.0) * DGFEM_EPSILON, &host), DGFEM_OK);
    shape_star_prism(&s);
    assert_int_equal(s.vertex_count, 36);
    assert_int_equal(s.face_count, 20);
    check_status(try_check(&s, DGFEM_R(8.0) * DGFEM_EPSILON, &host), DGFEM_OK);
    shape_torus(&s, 10, 10);
    check_status(try_check(&s, DGFEM_R(8.0) * DGFEM_EPSILON, &host), DGFEM_OK);
    shape_plate(&s);
    check_status(try_check(&s, 0, &host), DGFEM_OK);
    shape_bracket(&s);
    check_status(try_check(&s, 0, &host), DGFEM_OK);
    shape_hollow_box(&s, &scratch);
    check_status(try_check(&s, 0, &host), DGFEM_OK);
    shape_torus(&s, 64, 60); /* thousands of faces */
    check_status(try_check(&s, DGFEM_R(8.0) * DGFEM_EPSILON, &host), DGFEM_OK);
    assert_int_equal(host.log_count, 0);
}

static void flat_polyhedra_pass(void **state) {
    static const double origin[3] = {0, 0, 0};
    const double m[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, DGFEM_REAL_IS_FLOAT ? 1e-5 : 1e-6}};
    check_host host;
    (void)state;
    shape_plate(&s);
    shape_transform(&s, m, origin);
    check_status(try_check(&s, 0, &host), DGFEM_OK);
}

static void open_surfaces_are_found(void **state) {
    check_host host;
    (void)state;
    shape_box(&s, 0, 0, 0, 1, 1, 1);
    s.face_count = 5, s.loop_count = 5;
    check_status(try_check(&s, 0, &host), DGFEM_ERROR_OPEN);
    check_logged(&host, "edge from vertex");
    shape_box(&s, 0, 0, 0, 1, 1, 1);
    s.loop_vertices[0] = 1, s.loop_vertices[1] = 2, s.loop_vertices[2] = 3,
    s.loop_vertices[3] = 0; /* one face turned */
    check_status(try_check(&s, 0, &host), DGFEM_ERROR_OPEN);
    shape_box(&s, 0, 0, 0, 1, 1, 1);
    shape_quad(&s, 0, 1, 2, 3); /* one face twice, as a fold */
    check_status(try_check(&s, 0, &host), DGFEM_ERROR_OPEN);
}

static void wrong_geometry_is_found(void **state) {
    check_host host;
    (void)state;
    shape_box(&s, 0, 0, 0, 1, 1, 1);
    shape_reverse(&s);
    check_status(try_check(&s, 0, &host), DGFEM_ERROR_INSIDE_OUT);
    check_logged(&host, "volume -1");
    shape_box(&s, 0, 0, 0, 1, 1, 1);
    s.vertices[6].z = DGFEM_R(1.25);
    check_status(try_check(&s, DGFEM_R(1e-3), &host), DGFEM_ERROR_NOT_PLANAR);
    check_logged(&host, "face 1");
    check_status(try_check(&s, DGFEM_R(0.2), &host), DGFEM_OK);
    shape_box(&s, 0, 0, 0, 1, 1, 0);
    check_status(try_check(&s, 0, &host), DGFEM_ERROR_DEGENERATE);
    check_logged(&host, "face 2 has no area");
    shape_tetrahedron(&s);
    s.vertices[3].x = s.vertices[3].y = DGFEM_R(0.25), s.vertices[3].z = 0;
    check_status(try_check(&s, 0, &host), DGFEM_ERROR_DEGENERATE);
    check_logged(&host, "volume");
}

/* A prism over the region, checked. */
static dgfem_status try_region(const double *xy, const int *loops, int loop_count, check_host *host) {
    shape_prism(&s, xy, loops, loop_count, 0, 1);
    return try_check(&s, 0, host);
}

static void loops_that_meet_are_found(void **state) {
    static const double bow[8] = {0, 0, 4, 4, 4, 0, 0, 3};
    static const double touch[14] = {0, 0, 4, 0, 4, 4, 2, 0, 2, 4, 0, 4, 0, 2}; /* a vertex on an edge */
    static const double spike[12] = {0, 0, 4, 0, 6, 0, 4, 0, 4, 4, 0, 4};       /* out and back */
    static const double crossing[16] = {0, 0, 4, 0, 4, 4, 0, 4, 3, 1, 3, 2, 5, 2, 5, 1};
    static const double touching[16] = {0, 0, 4, 0, 4, 4, 0, 4, 2, 1, 2, 2, 4, 2, 3, 1};
    static const double outside[16] = {0, 0, 4, 0, 4, 4, 0, 4, 5, 1, 5, 2, 6, 2, 6, 1};
    static const double twice[16] = {0, 0, 4, 0, 4, 4, 0, 4, 1, 1, 2, 1, 2, 2, 1, 2};
    static const int one4[2] = {0, 4}, one6[2] = {0, 6}, one7[2] = {0, 7}, two[3] = {0, 4, 8};
    check_host host;
    (void)state;
    check_status(try_region(bow, one4, 1, &host), DGFEM_ERROR_NOT_SIMPLE);
    check_logged(&host, "face 0: edge");
    check_status(try_region(touch, one7, 1, &host), DGFEM_ERROR_NOT_SIMPLE);
    check_status(try_region(spike, one6, 1, &host), DGFEM_ERROR_NOT_SIMPLE);
    check_status(try_region(crossing, two, 2, &host), DGFEM_ERROR_NOT_SIMPLE);
    check_status(try_region(touching, two, 2, &host), DGFEM_ERROR_NOT_SIMPLE);
    check_logged(&host, "meets edge");
    check_status(try_region(outside, two, 2, &host), DGFEM_ERROR_NOT_SIMPLE); /* a hole outside */
    check_logged(&host, "loop 1");
    check_status(try_region(twice, two, 2, &host), DGFEM_ERROR_NOT_SIMPLE); /* an outer loop inside another */
    check_logged(&host, "neither a hole nor outside");
}

/* A vertex that a loop visits twice, and a hole that hangs on a vertex of the outer loop. */
static void loops_that_share_a_vertex_are_found(void **state) {
    check_host host;
    const int pinched[6] = {0, 1, 2, 0, 3, 4}, back[6] = {4, 3, 0, 2, 1, 0};
    (void)state;
    shape_begin(&s);
    shape_vertex(&s, 0, 0, 0), shape_vertex(&s, 2, 0, 0), shape_vertex(&s, 2, 1, 0), shape_vertex(&s, -2, 0, 0);
    shape_vertex(&s, -2, -1, 0);
    shape_face(&s);
    shape_loop(&s, pinched, 6);
    shape_face(&s);
    shape_loop(&s, back, 6);
    check_status(try_check(&s, 0, &host), DGFEM_ERROR_NOT_SIMPLE);
    check_logged(&host, "meets edge");
}

static void check_refuses_bad_tolerance(void **state) {
    dgfem_polyhedron *p;
    (void)state;
    shape_tetrahedron(&s);
    p = shape_polyhedron(&s);
    check_status(dgfem_polyhedron_check(NULL, 0), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_polyhedron_check(p, -1), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_polyhedron_check(p, (dgfem_real)NAN), DGFEM_ERROR_ARGUMENT);
    dgfem_polyhedron_destroy(p);
}

/* ---- measure ---- */

static void check_measure(double volume, double area, double x, double y, double z) {
    dgfem_polyhedron *p = shape_polyhedron(&s);
    const dgfem_measure measure = dgfem_polyhedron_measure(p);
    check_near(measure.volume, volume, tight * volume);
    check_near(measure.area, area, tight * area);
    check_near(measure.centroid.x, x, tight * 8);
    check_near(measure.centroid.y, y, tight * 8);
    check_near(measure.centroid.z, z, tight * 8);
    dgfem_polyhedron_destroy(p);
}

static void measures(void **state) {
    dgfem_measure nothing = dgfem_polyhedron_measure(NULL);
    dgfem_polyhedron *p;
    (void)state;
    assert_true(nothing.volume == 0 && nothing.area == 0);
    shape_tetrahedron(&s);
    check_measure(1.0 / 6, 1.5 + sqrt(3) / 2, 0.25, 0.25, 0.25);
    shape_box(&s, 1, 2, 3, 2, 4, 6);
    check_measure(6, 22, 1.5, 3, 4.5);
    shape_cut_cube(&s); /* 8 - 1/6; the corner tetrahedron has its centroid at 2 - 1/4 */
    check_measure(47.0 / 6, 24 - 1.5 + sqrt(3) / 2, (8 - 1.75 / 6) * 6 / 47, (8 - 1.75 / 6) * 6 / 47,
                  (8 - 1.75 / 6) * 6 / 47);
    shape_truncated_octahedron(&s); /* edge sqrt 2: 8 sqrt 2 a^3 and (6 + 12 sqrt 3) a^2 */
    check_measure(32, 12 + 24 * sqrt(3), 0, 0, 0);
    shape_bracket(&s);
    check_measure(14, 14 + 32, (4 * 2 + 3 * 0.5) / 7, (4 * 0.5 + 3 * 2.5) / 7, 1);
    shape_plate(&s);
    check_measure(2 * (48 - 4 - 8), 2 * (48 - 12) + 2 * (28 + 8 + 12), (48 * 4 - 4 * 2 - 8 * 6) / 36.0, 3, 1);
    shape_hollow_box(&s, &scratch);
    check_measure(56, 96 + 24, 2, 2, 2);
    shape_box(&s, 1, 2, 3, 2, 4, 6);
    shape_vertex(&s, 99, 99, 99); /* no face uses it */
    p = shape_polyhedron(&s);
    nothing = dgfem_polyhedron_measure(p);
    check_near3(nothing.lower, dgfemi_vec3(1, 2, 3), 0);
    check_near3(nothing.upper, dgfemi_vec3(2, 4, 6), 0);
    dgfem_polyhedron_destroy(p);
}

/* ---- contains ---- */

static int in_bracket(double x, double y, double z) {
    return z > 0 && z < 2 && ((x > 0 && x < 4 && y > 0 && y < 1) || (x > 0 && x < 1 && y > 0 && y < 4));
}
static int in_plate(double x, double y, double z) {
    return z > 0 && z < 2 && x > 0 && x < 8 && y > 0 && y < 6 && !(x >= 1 && x <= 3 && y >= 2 && y <= 4) &&
           !(x >= 5 && x <= 7 && y >= 1 && y <= 5);
}
static int in_hollow_box(double x, double y, double z) {
    return x > 0 && x < 4 && y > 0 && y < 4 && z > 0 && z < 4 &&
           !(x >= 1 && x <= 3 && y >= 1 && y <= 3 && z >= 1 && z <= 3);
}

/* Points of the half lattice lie in the planes of faces, straight above vertices and edges. Those on the surface may be
   either and are left out. */
static void check_contains(int (*inside)(double, double, double)) {
    dgfem_polyhedron *p = shape_polyhedron(&s);
    const double step = 0.5, near_by = 1.0 / 64;
    int i, j, k, n;
    for (i = -2; i <= 18; i++)
        for (j = -2; j <= 14; j++)
            for (k = -2; k <= 10; k++) {
                const double x = i * step, y = j * step, z = k * step;
                int same = 1;
                for (n = 0; n < 27; n++)
                    if (inside(x + (n % 3 - 1) * near_by, y + (n / 3 % 3 - 1) * near_by, z + (n / 9 - 1) * near_by) !=
                        inside(x, y, z))
                        same = 0;
                if (same)
                    assert_int_equal(
                        dgfem_polyhedron_contains(p, dgfemi_vec3((dgfem_real)x, (dgfem_real)y, (dgfem_real)z)),
                        inside(x, y, z));
            }
    dgfem_polyhedron_destroy(p);
}

static void contains_on_the_lattice(void **state) {
    (void)state;
    shape_bracket(&s);
    check_contains(in_bracket);
    shape_plate(&s);
    check_contains(in_plate);
    shape_hollow_box(&s, &scratch);
    check_contains(in_hollow_box);
}

/* The winding number by the solid angles of a fan, good away from the surface. */
static double winding_by_angles(const shape *solid, dgfem_vec3 point, double *closest) {
    double sum = 0;
    int l, i;
    *closest = 1e30;
    for (l = 0; l < solid->loop_count; l++)
        for (i = solid->loop_start[l] + 1; i + 1 < solid->loop_start[l + 1]; i++) {
            const dgfem_vec3 a = dgfemi_sub(solid->vertices[solid->loop_vertices[solid->loop_start[l]]], point);
            const dgfem_vec3 b = dgfemi_sub(solid->vertices[solid->loop_vertices[i]], point);
            const dgfem_vec3 c = dgfemi_sub(solid->vertices[solid->loop_vertices[i + 1]], point);
            const dgfem_vec3 normal = dgfemi_normalized(dgfemi_cross(dgfemi_sub(b, a), dgfemi_sub(c, a)));
            const double la = (double)dgfemi_norm(a), lb = (double)dgfemi_norm(b), lc = (double)dgfemi_norm(c);
            const double numerator = (double)dgfemi_triple_product(a, b, c);
            const double denominator = la * lb * lc + (double)dgfemi_dot(a, b) * lc + (double)dgfemi_dot(b, c) * la +
                                       (double)dgfemi_dot(c, a) * lb;
            sum += 2 * atan2(numerator, denominator);
            *closest = fmin(*closest, fabs((double)dgfemi_dot(normal, a)));
        }
    return sum / (4 * 3.14159265358979324);
}

static void contains_at_random(void **state) {
    check_random random = check_random_seeded(5);
    int kind, round, tried = 0, inside = 0;
    (void)state;
    for (kind = 0; kind < 4; kind++) {
        dgfem_polyhedron *p;
        if (kind == 0) shape_torus(&s, 10, 10);
        if (kind == 1) shape_star_prism(&s);
        if (kind == 2) shape_truncated_octahedron(&s);
        if (kind == 3) shape_plate(&s);
        p = shape_polyhedron(&s);
        for (round = 0; round < 500; round++) {
            const dgfem_vec3 point = check_random_vec3(&random, -6, 8);
            double closest;
            const double winding = winding_by_angles(&s, point, &closest);
            if (closest < 1e-3) continue;
            tried++;
            inside += winding > 0.5;
            assert_int_equal(dgfem_polyhedron_contains(p, point), winding > 0.5);
        }
        dgfem_polyhedron_destroy(p);
    }
    assert_true(tried > 1500 && inside > 100);
}

/* Straight above and below vertices and edges of a triangulated surface a ray is neither counted twice nor lost. */
static void contains_in_line_with_vertices(void **state) {
    dgfem_polyhedron *p;
    int v;
    (void)state;
    shape_torus(&s, 12, 8);
    p = shape_polyhedron(&s);
    for (v = 0; v < s.vertex_count; v++) {
        dgfem_vec3 point = s.vertices[v];
        const int upper = v % 8 >= 1 && v % 8 <= 3, lower = v % 8 >= 5;
        point.z = -9;
        assert_false(dgfem_polyhedron_contains(p, point));
        point.z = 9;
        assert_false(dgfem_polyhedron_contains(p, point));
        point.z = 0;
        if (upper || lower) assert_true(dgfem_polyhedron_contains(p, point));
    }
    assert_false(dgfem_polyhedron_contains(p, dgfemi_vec3(0, 0, 0)));
    assert_false(dgfem_polyhedron_contains(p, dgfemi_vec3((dgfem_real)NAN, 0, 0)));
    assert_false(dgfem_polyhedron_contains(NULL, dgfemi_vec3(0, 0, 0)));
    dgfem_polyhedron_destroy(p);
}

/* ---- exact predicates ---- */

static int exact_orientation(const double *a, const double *b, const double *c) {
    mpq_t v[6], left, right;
    int i, sign;
    for (i = 0; i < 6; i++) mpq_init(v[i]);
    mpq_inits(left, right, NULL);
    for (i = 0; i < 2; i++) mpq_set_d(v[i], a[i]), mpq_set_d(v[2 + i], b[i]), mpq_set_d(v[4 + i], c[i]);
    for (i = 0; i < 4; i++) mpq_sub(v[i], v[i], v[4 + i % 2]);
    mpq_mul(left, v[0], v[3]);
    mpq_mul(right, v[1], v[2]);
    sign = mpq_cmp(left, right);
    for (i = 0; i < 6; i++) mpq_clear(v[i]);
    mpq_clears(left, right, NULL);
    return sign > 0 ? 1 : sign < 0 ? -1 : 0;
}

static void orientation_is_exact(void **state) {
    check_random random = check_random_seeded(6);
    int round, signs[3] = {0, 0, 0}, plain_wrong = 0;
    (void)state;
    for (round = 0; round < 30000; round++) {
        double a[2], b[2], c[2], t = check_random_real(&random, -2, 3);
        double plain;
        int i, sign;
        for (i = 0; i < 2; i++) {
            a[i] = check_random_real(&random, -1, 1), b[i] = check_random_real(&random, -1, 1);
            if (round % 3 == 1) a[i] = floor(a[i] * 8) / 8, b[i] = floor(b[i] * 8) / 8, t = floor(t * 4) / 4;
            c[i] = a[i] + t * (b[i] - a[i]); /* on the line but for round-off */
            if (round % 3 == 2 && check_random_int(&random, 4) == 0) c[i] = nextafter(c[i], 10);
            if (round % 7 == 3) a[i] += 1e6, b[i] += 1e6, c[i] += 1e6;
        }
        sign = dgfemi_orientation(a, b, c);
        plain = (a[0] - c[0]) * (b[1] - c[1]) - (a[1] - c[1]) * (b[0] - c[0]);
        plain_wrong += sign != (plain > 0) - (plain < 0);
        assert_int_equal(sign, exact_orientation(a, b, c));
        assert_int_equal(dgfemi_orientation(b, c, a), sign);
        assert_int_equal(dgfemi_orientation(b, a, c), -sign);
        signs[sign + 1]++;
    }
    assert_true(signs[0] > 1000 && signs[1] > 1000 && signs[2] > 1000);
    assert_true(plain_wrong > 100); /* or the test tests nothing */
}

/* ---- triangles ---- */

static double cross2(const double *a, const double *b, const double *c) {
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

/* Triangles that all run counter-clockwise and whose directed edges cancel but for those of the loops, each once, cover
   each point as often as the loops wind round it: once inside, never outside. So that is all there is to check. */
static void check_cover(const shape *solid, int face) {
    enum { ROOM = 4096 };
    static int triangles[3 * ROOM];
    static struct { int a, b, balance; } edges[3 * ROOM + SHAPE_CORNERS];
    dgfem_polyhedron *p = shape_polyhedron(solid);
    const dgfem_vec3 normal = dgfemi_polyhedron_vector_area(p, face);
    int count, again, t, k, l, i, e, edge_count = 0, u, v;
    check_status(dgfem_polyhedron_triangulate_face(p, face, NULL, 0, &count), DGFEM_OK);
    assert_true(count <= ROOM);
    check_status(dgfem_polyhedron_triangulate_face(p, face, triangles, ROOM, &again), DGFEM_OK);
    assert_int_equal(count, again);
    dgfemi_projection_axes(normal, &u, &v);
    for (t = 0; t < count; t++) {
        double corners[3][2];
        for (k = 0; k < 3; k++) {
            const dgfem_vec3 q = solid->vertices[triangles[3 * t + k]];
            corners[k][0] = (double)dgfemi_axis(q, u), corners[k][1] = (double)dgfemi_axis(q, v);
            edges[edge_count].a = triangles[3 * t + k], edges[edge_count].b = triangles[3 * t + (k + 1) % 3];
            edges[edge_count++].balance = 1;
        }
        assert_int_equal(exact_orientation(corners[0], corners[1], corners[2]), 1);
    }
    for (l = solid->face_loops[face]; l < solid->face_loops[face + 1]; l++)
        for (i = solid->loop_start[l]; i < solid->loop_start[l + 1]; i++) {
            const int next = i + 1 < solid->loop_start[l + 1] ? i + 1 : solid->loop_start[l];
            edges[edge_count].a = solid->loop_vertices[next], edges[edge_count].b = solid->loop_vertices[i];
            edges[edge_count++].balance = 1;
        }
    for (e = 0; e < edge_count; e++) {
        int sum = 0;
        if (edges[e].balance == 0) continue;
        for (i = e; i < edge_count; i++) {
            const int same = edges[i].a == edges[e].a && edges[i].b == edges[e].b;
            const int opposite = edges[i].a == edges[e].b && edges[i].b == edges[e].a;
            if (!same && !opposite) continue;
            if (edges[i].balance) sum += same ? 1 : -1;
            edges[i].balance = 0;
        }
        assert_int_equal(sum, 0);
    }
    dgfem_polyhedron_destroy(p);
}

static void check_all_covers(void) {
    int f;
    for (f = 0; f < s.face_count; f++) check_cover(&s, f);
}

static void faces_of_shapes_are_covered(void **state) {
    (void)state;
    shape_tetrahedron(&s);
    check_all_covers();
    shape_cut_cube(&s);
    check_all_covers();
    shape_truncated_octahedron(&s);
    check_all_covers();
    shape_star_prism(&s);
    check_all_covers();
    shape_bracket(&s);
    check_all_covers();
    shape_plate(&s);
    check_all_covers();
}

/* The boundary of a random set of cells of a lattice, with a corner at every lattice point on it: holes, islands in
   holes, straight angles everywhere. Where cells touch at a corner only, loops would touch: such corners are filled. */
static void random_cells(check_random *random, int size) {
    enum { MAX = 24 };
    static int cells[MAX + 2][MAX + 2], vertex[MAX + 3][MAX + 3];
    static double xy[2048];
    int loops[512], loop_count = 0, n = 0, i, j, again;
    static unsigned char used[MAX + 3][MAX + 3]; /* lattice points already in a loop */
    static const int step[4][2] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}};
    do {
        memset(cells, 0, sizeof cells);
        for (i = 1; i <= size; i++)
            for (j = 1; j <= size; j++) cells[i][j] = check_random_int(random, 100) < 62;
        cells[1][1] = 1;
        do
            for (again = 0, i = 0; i <= size; i++)
                for (j = 0; j <= size; j++) {
                    const int a = cells[i][j], b = cells[i + 1][j], c = cells[i][j + 1], d = cells[i + 1][j + 1];
                    if (a == d && b == c && a != b) {
                        if (i >= 1 && j >= 1) cells[i][j] = 1;
                        if (i < size && j >= 1) cells[i + 1][j] = 1;
                        if (i >= 1 && j < size) cells[i][j + 1] = 1;
                        if (i < size && j < size) cells[i + 1][j + 1] = 1;
                        again = 1;
                    }
                }
        while (again);
        memset(used, 0, sizeof used), memset(vertex, 0, sizeof vertex);
        loop_count = n = 0;
        loops[0] = 0;
        /* Start at the lower edge of a cell without a lower neighbour and walk with cells on the left. */
        for (j = 1; j <= size + 1; j++)
            for (i = 1; i <= size; i++) {
                int x = i, y = j, direction = 0;
                if (used[x][y] || cells[i][j] == cells[i][j - 1]) continue;
                if (!cells[i][j]) x = i + 1, direction = 2; /* an upper edge: the cell is below, walk back */
                if (used[x][y]) continue;
                do {
                    int turn, next = 0;
                    used[x][y] = 1;
                    xy[2 * n] = x, xy[2 * n + 1] = y;
                    n++;
                    x += step[direction][0], y += step[direction][1];
                    for (turn = 1; turn >= -1;
                         turn--) { /* the direction that has a cell on its left, none on its right */
                        const int to = (direction + turn + 4) % 4;
                        const int left = to == 0   ? cells[x][y]
                                         : to == 1 ? cells[x - 1][y]
                                         : to == 2 ? cells[x - 1][y - 1]
                                                   : cells[x][y - 1];
                        const int right = to == 0   ? cells[x][y - 1]
                                          : to == 1 ? cells[x][y]
                                          : to == 2 ? cells[x - 1][y]
                                                    : cells[x - 1][y - 1];
                        if (left && !right) next = to;
                    }
                    direction = next;
                } while (!used[x][y]);
                loops[++loop_count] = n;
            }
    } while (n > 500);
    shape_prism(&s, xy, loops, loop_count, 0, 1);
}

/* A star with random radii and a ring of square holes between the axes. */
static void random_star_with_holes(check_random *random) {
    double xy[512];
    int loops[16], n = 12 + check_random_int(random, 40), holes = check_random_int(random, 9), h, i;
    for (i = 0; i < n; i++) {
        const double radius = check_random_real(random, 6, 14), angle = 2 * 3.14159265358979324 * i / n;
        xy[2 * i] = radius * cos(angle), xy[2 * i + 1] = radius * sin(angle);
    }
    loops[0] = 0, loops[1] = n;
    for (h = 0; h < holes; h++) {
        const int corners = 3 + check_random_int(random, 4);
        for (i = 0; i < corners; i++, n++) {
            const double angle = -2 * 3.14159265358979324 * i / corners;
            xy[2 * n] = 0.5 * cos(angle) + 1.5 * (h % 3 - 1), xy[2 * n + 1] = 0.5 * sin(angle) + 1.5 * (h / 3 - 1);
        }
        loops[h + 2] = n;
    }
    shape_prism(&s, xy, loops, holes + 1, 0, 1);
}

/* Two interlocked spirals: the worst for ears. */
static void spiral(int turns) {
    static double xy[2048];
    int loops[2] = {0, 0}, n = 0, i;
    for (i = 0; i <= 8 * turns; i++, n++) {
        const double r = 2 + i / 8.0, angle = 2 * 3.14159265358979324 * i / 8;
        xy[2 * n] = r * cos(angle), xy[2 * n + 1] = r * sin(angle);
    }
    for (i = 8 * turns; i >= 0; i--, n++) {
        const double r = 1.5 + i / 8.0, angle = 2 * 3.14159265358979324 * i / 8;
        xy[2 * n] = r * cos(angle), xy[2 * n + 1] = r * sin(angle);
    }
    loops[1] = n;
    shape_prism(&s, xy, loops, 1, 0, 1);
    shape_reverse(&s); /* the loop ran clockwise */
}

/* Turned so that another axis is dropped, sheared, tiny or far away. Turns and powers of two keep planes exact; shears
   only nearly, which must not matter. */
static void random_position(check_random *random) {
    static const double origin[3] = {0, 0, 0};
    double m[3][3] = {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}, t[3];
    const int axis = check_random_int(random, 3), kind = check_random_int(random, 4);
    const double size = kind == 1 ? 0x1p-30 : 1, flip = check_random_int(random, 2) ? 1 : -1;
    int i;
    for (i = 0; i < 3; i++) m[i][(i + axis) % 3] = size, t[i] = kind == 2 ? 1024 : 0;
    for (i = 0; i < 3; i++) m[2][i] *= flip, m[0][i] *= flip;
    shape_transform(&s, (const double(*)[3])m, kind == 2 ? t : origin);
}

static void random_faces_are_covered(void **state) {
    check_random random = check_random_seeded(7);
    const int rounds = check_long() ? 20000 : 300;
    int round, holes = 0;
    (void)state;
    for (round = 0; round < rounds; round++) {
        if (round % 3 == 0) random_star_with_holes(&random);
        else random_cells(&random, 3 + check_random_int(&random, check_long() ? 14 : 9));
        random_position(&random);
        holes += s.face_loops[1] - 1;
        check_cover(&s, 0);
        check_cover(&s, 1);
    }
    assert_true(holes > rounds);
    for (round = 1; round < 6; round++) {
        spiral(round * 8);
        check_cover(&s, 0);
        check_cover(&s, 1);
    }
}

static void random_faces_pass_the_check(void **state) {
    check_random random = check_random_seeded(8);
    check_host host;
    int round;
    (void)state;
    for (round = 0; round < 100; round++) {
        if (round % 3 == 0) random_star_with_holes(&random);
        else random_cells(&random, 3 + check_random_int(&random, 9));
        check_status(try_check(&s, DGFEM_R(8.0) * DGFEM_EPSILON, &host), DGFEM_OK);
    }
}

/* Lists of triangles are cut off at the capacity, and the count is what it would have been. */
static void triangles_within_capacity(void **state) {
    int triangles[3 * 40], count, i;
    dgfem_polyhedron *p;
    (void)state;
    shape_plate(&s);
    p = shape_polyhedron(&s);
    for (i = 0; i < 120; i++) triangles[i] = -7;
    check_status(dgfem_polyhedron_triangulate_face(p, 1, triangles, 5, &count), DGFEM_OK);
    assert_int_equal(count, 12 + 2 * 2 - 2);
    for (i = 0; i < 120; i++) assert_true((triangles[i] == -7) == (i >= 15));
    dgfem_polyhedron_destroy(p);
}

static void triangles_refuse_bad_calls(void **state) {
    dgfem_polyhedron_desc desc;
    dgfem_polyhedron *p;
    check_host host;
    int triangles[3], count;
    (void)state;
    shape_tetrahedron(&s);
    desc = shape_desc(&s);
    desc.hooks = check_hooks(&host);
    check_status(dgfem_polyhedron_create(&desc, &p), DGFEM_OK);
    check_status(dgfem_polyhedron_triangulate_face(NULL, 0, triangles, 1, &count), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_polyhedron_triangulate_face(p, 4, triangles, 1, &count), DGFEM_ERROR_INDEX);
    check_logged(&host, "face 4 of 4");
    check_status(dgfem_polyhedron_triangulate_face(p, -1, triangles, 1, &count), DGFEM_ERROR_INDEX);
    host.log_count = 0;
    check_status(dgfem_polyhedron_triangulate_face(p, 0, NULL, 1, &count), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "no room");
    check_status(dgfem_polyhedron_triangulate_face(p, 0, triangles, -1, &count), DGFEM_ERROR_ARGUMENT);
    host.log_count = 0;
    check_status(dgfem_polyhedron_triangulate_face(p, 0, triangles, 1, NULL), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_polyhedron_triangulate_face(p, 0, triangles, 1, &count), DGFEM_OK);
    assert_int_equal(count, 1);
    dgfem_polyhedron_destroy(p);
}

/* Faces that are not simple still get the right number of triangles with the right boundary. */
static void wrong_faces_end(void **state) {
    static const double bow[8] = {0, 0, 4, 4, 4, 0, 0, 3};
    static const double line[8] = {0, 0, 1, 1, 2, 2, 3, 3};
    static const double crossing[16] = {0, 0, 4, 0, 4, 4, 0, 4, 3, 1, 3, 2, 5, 2, 5, 1};
    static const double outside[16] = {0, 0, 4, 0, 4, 4, 0, 4, 5, 4, 9, 4, 9, 0, 5, 0}; /* no area in all */
    static const int one[2] = {0, 4}, two[3] = {0, 4, 8};
    const double *regions[4];
    int triangles[60], k, f, count, room;
    (void)state;
    regions[0] = bow, regions[1] = line, regions[2] = crossing, regions[3] = outside;
    for (k = 0; k < 4; k++) {
        dgfem_polyhedron *p;
        shape_prism(&s, regions[k], k < 2 ? one : two, k < 2 ? 1 : 2, 0, 1);
        p = shape_polyhedron(&s);
        for (f = 0; f < 2; f++) {
            check_status(dgfem_polyhedron_triangulate_face(p, f, NULL, 0, &count), DGFEM_OK);
            check_status(dgfem_polyhedron_triangulate_face(p, f, triangles, 20, &room), DGFEM_OK);
            assert_int_equal(room, count);
            assert_int_equal(count, k < 2 ? 2 : 8);
        }
        dgfem_polyhedron_destroy(p);
    }
    assert_true(cross2(bow, bow + 2, bow + 4) < 0);
}

/* ---- components ---- */

static void check_components(const double *volumes, int expected) {
    dgfem_polyhedron *p = shape_polyhedron(&s), *part;
    int count, k;
    check_status(dgfem_polyhedron_component_count(p, &count), DGFEM_OK);
    assert_int_equal(count, expected);
    for (k = 0; k < count; k++) {
        check_status(dgfem_polyhedron_component(p, k, &part), DGFEM_OK);
        check_status(dgfem_polyhedron_check(part, 0), DGFEM_OK);
        check_near(dgfem_polyhedron_measure(part).volume, volumes[k], tight * volumes[k]);
        dgfem_polyhedron_destroy(part);
    }
    check_status(dgfem_polyhedron_component(p, count, &part), DGFEM_ERROR_INDEX);
    assert_null(part);
    check_status(dgfem_polyhedron_component(p, -1, &part), DGFEM_ERROR_INDEX);
    check_status(dgfem_polyhedron_component(p, 0, NULL), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_polyhedron_component_count(p, NULL), DGFEM_ERROR_ARGUMENT);
    dgfem_polyhedron_destroy(p);
}

static void components_and_voids(void **state) {
    static const double one[1] = {36 * 2}, two[2] = {8, 27}, nested[3] = {1000 - 512, 216 - 8, 1};
    static const double apart[2] = {64 - 8, 64 - 1}, touching[2] = {1, 1};
    int k;
    (void)state;
    shape_plate(&s);
    check_components(one, 1);
    shape_box(&s, 0, 0, 0, 2, 2, 2);
    shape_box(&scratch, 5, 0, 0, 8, 3, 3);
    shape_append(&s, &scratch);
    check_components(two, 2);
    /* a box, its void, a box in the void with a void of its own, and a box in that */
    shape_box(&s, 0, 0, 0, 10, 10, 10);
    for (k = 1; k < 5; k++) {
        const double lower[5] = {0, 1, 2, 4, 4.5}, upper[5] = {0, 9, 8, 6, 5.5};
        shape_box(&scratch, lower[k], lower[k], lower[k], upper[k], upper[k], upper[k]);
        if (k % 2) shape_reverse(&scratch);
        shape_append(&s, &scratch);
    }
    check_components(nested, 3);
    /* two boxes, the void of each */
    shape_hollow_box(&s, &scratch);
    shape_box(&scratch, 10, 0, 0, 14, 4, 4);
    shape_append(&s, &scratch);
    shape_box(&scratch, 11, 1, 1, 12, 2, 2);
    shape_reverse(&scratch);
    shape_append(&s, &scratch);
    check_components(apart, 2);
    /* two boxes that share one vertex: no common edge */
    shape_box(&s, 0, 0, 0, 1, 1, 1);
    shape_box(&scratch, 1, 1, 1, 2, 2, 2);
    k = s.corner_count;
    shape_append(&s, &scratch);
    for (; k < s.corner_count; k++)
        if (s.loop_vertices[k] == 8) s.loop_vertices[k] = 6;
    check_components(touching, 2);
    check_status(dgfem_polyhedron_component_count(NULL, &k), DGFEM_ERROR_ARGUMENT);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(creation_copies),
        cmocka_unit_test(creation_without_face_loops),
        cmocka_unit_test(creation_refuses_bad_input),
        cmocka_unit_test(creation_refuses_bad_loops),
        cmocka_unit_test(every_allocation_may_fail),
        cmocka_unit_test(good_polyhedra_pass),
        cmocka_unit_test(flat_polyhedra_pass),
        cmocka_unit_test(open_surfaces_are_found),
        cmocka_unit_test(wrong_geometry_is_found),
        cmocka_unit_test(loops_that_meet_are_found),
        cmocka_unit_test(loops_that_share_a_vertex_are_found),
        cmocka_unit_test(check_refuses_bad_tolerance),
        cmocka_unit_test(measures),
        cmocka_unit_test(contains_on_the_lattice),
        cmocka_unit_test(contains_at_random),
        cmocka_unit_test(contains_in_line_with_vertices),
        cmocka_unit_test(orientation_is_exact),
        cmocka_unit_test(faces_of_shapes_are_covered),
        cmocka_unit_test(random_faces_are_covered),
        cmocka_unit_test(random_faces_pass_the_check),
        cmocka_unit_test(triangles_within_capacity),
        cmocka_unit_test(triangles_refuse_bad_calls),
        cmocka_unit_test(wrong_faces_end),
        cmocka_unit_test(components_and_voids),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
