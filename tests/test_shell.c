/* Shells at rest: meshes and their refusal, zero modes, patch tests, strains and tangents against finite differences,
   rigid motion, static solves. */
#define DGFEM_IMPLEMENTATION
#include "dgfem_shell.h"
#include "check.h"
#include "check_shell.h"

/* What is compared with differences: step and tolerance of central ones in this precision. */
#define STEP (DGFEM_REAL_IS_FLOAT ? 5e-3 : 1e-5)

/* ---- mesh ---- */

static void counts_and_boundary(void **state) {
    (void)state;
    dgfem_shell_desc desc = shell_desc();
    for (int triangles = 0; triangles < 2; triangles++) {
        dgfem_shell *shell = shell_make(&desc, 3, 2, triangles, map_flat);
        int edges[64], starts[65];
        assert_int_equal(shell->element_count, triangles ? 12 : 6);
        assert_int_equal(shell->edge_count, triangles ? 23 : 17);
        assert_int_equal(shell->node_count, triangles ? 35 : 29);
        assert_int_equal(dgfem_shell_boundary(shell, edges, starts), 1);
        assert_int_equal(starts[0], 0);
        assert_int_equal(starts[1], 10);
        for (int i = 0, b = 0; i < shell->edge_count; i++) {
            int boundary = shell->edges[i].element[1] == DGFEM_NONE;
            assert_int_equal(shell->edges[i].loop, boundary ? 0 : DGFEM_NONE);
            assert_true(!boundary || edges[0] <= i); /* it starts at its lowest edge */
            b += boundary;
            assert_true(b <= 10);
        }
        for (int i = 0; i < 10; i++) /* one closed loop, counter-clockwise */
            assert_int_equal(shell->edges[edges[i]].node[1], shell->edges[edges[(i + 1) % 10]].node[0]);
        check_near(dgfem_shell_area(shell), 1, 64 * CHECK_EPSILON);
        check_near(dgfem_shell_mass(shell), 1, 64 * CHECK_EPSILON);
        dgfem_shell_destroy(shell);
    }
    dgfem_shell *tube = shell_make(&desc, 8, 2, 0, map_tube);
    int starts[65];
    assert_int_equal(dgfem_shell_boundary(tube, NULL, starts), 2);
    assert_int_equal(starts[1], 8);
    assert_int_equal(tube->node_count, 24 + 24 + 16);
    check_near(dgfem_shell_area(tube), 4 * 3.14159265, 0.01);
    dgfem_shell_destroy(tube);
}

static dgfem_vec3 on_sphere(void *user, dgfem_vec3 x, dgfem_vec3 a, dgfem_vec3 b) {
    double length = sqrt((double)(x.x * x.x + x.y * x.y + x.z * x.z));
    (void)a, (void)b;
    ++*(int *)user;
    return at3((double)x.x / length, (double)x.y / length, (double)x.z / length);
}

static void middles_on_a_surface(void **state) {
    static const double points[] = {1, 0, 0, 0, 1, 0, 0, 0, 1, -1, 0, 0, 0, -1, 0, 0, 0, -1};
    static const int faces[] = {0, 1, 2, 1, 3, 2, 3, 4, 2, 4, 0, 2, 1, 0, 5, 3, 1, 5, 4, 3, 5, 0, 4, 5};
    dgfem_shell_desc desc = shell_desc();
    dgfem_shell *shell;
    int calls = 0;
    (void)state;
    desc.vertices = dgfem_points_in_double(points, 6);
    desc.triangles = faces, desc.triangle_count = 8;
    desc.surface = on_sphere, desc.surface_user = &calls;
    check_status(dgfem_shell_create(&desc, &shell), DGFEM_OK);
    assert_int_equal(shell->node_count, 18);
    assert_int_equal(dgfem_shell_boundary(shell, NULL, NULL), 0);
    for (int i = 0; i < 18; i++) {
        dgfem_vec3 x = shell->rest[i];
        check_near(x.x * x.x + x.y * x.y + x.z * x.z, 1, 8 * CHECK_EPSILON);
    }
    assert_true(calls >= 12);
    dgfem_shell_destroy(shell);
}

/* One bad mesh after the other, and what the log says about it. */
static void refuses_bad_meshes(void **state) {
    static const double points[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0, 0, 0, 1, 2, 0, 0};
    static const int three[] = {0, 1, 2, 1, 3, 2, 2, 1, 4}, reversed[] = {0, 1, 2, 1, 2, 3};
    static const int range[] = {0, 1, 6}, twice[] = {0, 1, 1}, single[] = {0, 1, 2};
    check_host host;
    dgfem_shell_desc desc = shell_desc(), bad;
    dgfem_shell *shell = NULL;
    (void)state;
    desc.hooks = check_hooks(&host);
    desc.vertices = dgfem_points_in_double(points, 5);
    desc.triangles = three, desc.triangle_count = 3;
    check_status(dgfem_shell_create(&desc, &shell), DGFEM_ERROR_NOT_CONFORMING);
    check_logged(&host, "vertices 2 and 1");
    assert_null(shell);
    desc.vertices.count = 4;
    desc.triangles = reversed, desc.triangle_count = 2;
    check_status(dgfem_shell_create(&desc, &shell), DGFEM_ERROR_INSIDE_OUT);
    check_logged(&host, "elements 0 and 1");
    desc.vertices.count = 6;
    desc.triangle_count = 1;
    desc.triangles = range;
    check_status(dgfem_shell_create(&desc, &shell), DGFEM_ERROR_INDEX);
    check_logged(&host, "vertex 6 of 6");
    desc.triangles = twice;
    check_status(dgfem_shell_create(&desc, &shell), DGFEM_ERROR_DEGENERATE);
    check_logged(&host, "vertex 1 twice");
    desc.triangles = single;
    check_status(dgfem_shell_create(&desc, &shell), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "vertex 3 belongs to no element");
    static const double line[] = {0, 0, 0, 1, 0, 0, 2, 0, 0};
    static const int line_faces[] = {0, 1, 2};
    desc.vertices = dgfem_points_in_double(line, 3);
    desc.triangles = line_faces;
    check_status(dgfem_shell_create(&desc, &shell), DGFEM_ERROR_DEGENERATE);
    check_logged(&host, "element 0 has no tangent plane");
    static const double dart[] = {0, 0, 0, 2, 0, 0, 0.5, 0.5, 0, 0, 2, 0};
    static const int dart_faces[] = {0, 1, 2, 3}, bow_faces[] = {0, 1, 3, 2};
    desc.vertices = dgfem_points_in_double(dart, 4);
    desc.triangle_count = 0;
    desc.quads = dart_faces, desc.quad_count = 1;
    check_status(dgfem_shell_create(&desc, &shell), DGFEM_ERROR_DEGENERATE);
    check_logged(&host, "element 0 is concave or tangled");
    desc.quads = bow_faces;
    check_status(dgfem_shell_create(&desc, &shell), DGFEM_ERROR_DEGENERATE);
    check_logged(&host, "element 0");
    desc.quads = NULL, desc.quad_count = 0, desc.triangle_count = 1;
    desc.vertices = dgfem_points_in_double(points, 3);
    desc.triangles = single;
    bad = desc, bad.thickness = 0;
    check_status(dgfem_shell_create(&bad, &shell), DGFEM_ERROR_MATERIAL);
    check_logged(&host, "thickness");
    bad = desc, bad.material.poisson = (dgfem_real)0.6;
    check_status(dgfem_shell_create(&bad, &shell), DGFEM_ERROR_MATERIAL);
    check_logged(&host, "Poisson");
    bad = desc, bad.eta_triangle = (dgfem_real)NAN;
    check_status(dgfem_shell_create(&bad, &shell), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "eta_triangle");
    bad = desc, bad.triangle_count = 0;
    check_status(dgfem_shell_create(&bad, &shell), DGFEM_ERROR_EMPTY);
    check_logged(&host, "no elements");
    bad = desc, bad.cookie = 0;
    check_status(dgfem_shell_create(&bad, &shell), DGFEM_ERROR_DESCRIPTOR);
    double nan_points[9];
    memcpy(nan_points, points, sizeof nan_points);
    nan_points[4] = (double)NAN;
    desc.vertices = dgfem_points_in_double(nan_points, 3);
    check_status(dgfem_shell_create(&desc, &shell), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "vertex 1");
    assert_int_equal(host.live, 0);
}

/* Where middle nodes are given, they say who the neighbours are:

        6 - 5 - 4 - 9 - 8      Side 2 4 of the left element is that of 2 4 or 4 2 on the right, with the same middle;
        |       |       |      a finer right side would make its corner of the left side's middle. */
static void refuses_given_middles_that_do_not_fit(void **state) {
    static const double points[] = {0,   0, 0,   0.5, 0, 0,   1,   0, 0, 1,    0.5, 0,   1,   1, 0, 0.5,  1,
                                    0,   0, 1,   0,   0, 0.5, 0,   2, 1, 0,    1.5, 1,   0,   2, 0, 0,    2,
                                    0.5, 0, 1.5, 0,   0, 1,   0.5, 0, 2, 0.25, 0,   1.5, 0.5, 0, 1, 0.25, 0};
    static const int good[] = {0, 2, 4, 6, 1, 3, 5, 7, 2, 10, 8, 4, 12, 11, 9, 3};
    static const int other_middle[] = {0, 2, 4, 6, 1, 3, 5, 7, 2, 10, 8, 4, 12, 11, 9, 13};
    static const int hanging[] = {0, 2, 4, 6, 1, 3, 5, 7, 2, 10, 11, 3, 12, 14, 15, 16};
    static const int hanging_first[] = {2, 10, 11, 3, 12, 14, 15, 16, 0, 2, 4, 6, 1, 3, 5, 7};
    dgfem_shell_desc desc = shell_desc();
    dgfem_shell *shell;
    check_host host;
    (void)state;
    desc.hooks = check_hooks(&host);
    desc.nodes_per_quad = 8, desc.quad_count = 2;
    desc.vertices = dgfem_points_in_double(points, 13);
    desc.quads = good;
    check_status(dgfem_shell_create(&desc, &shell), DGFEM_OK);
    assert_int_equal(shell->edge_count, 7);
    dgfem_shell_destroy(shell);
    desc.vertices.count = 14;
    desc.quads = other_middle;
    check_status(dgfem_shell_create(&desc, &shell), DGFEM_ERROR_NOT_CONFORMING);
    check_logged(&host, "element 1: the side of vertices 4 and 2 has the middle node 13, that of another element 3");
    static double used[51]; /* the same without vertices 8, 9 and 13, which the hanging meshes do not use */
    static int renamed[16];
    int number[17], count = 0;
    for (int i = 0; i < 17; i++) {
        number[i] = count;
        if (i == 8 || i == 9 || i == 13) continue;
        memcpy(used + 3 * count++, points + 3 * i, 3 * sizeof *used);
    }
    desc.vertices = dgfem_points_in_double(used, count);
    desc.quads = renamed;
    for (int first = 0; first < 2; first++) {
        for (int i = 0; i < 16; i++) renamed[i] = number[first ? hanging_first[i] : hanging[i]];
        check_status(dgfem_shell_create(&desc, &shell), DGFEM_ERROR_NOT_CONFORMING);
        check_logged(&host, first ? "vertex 3 is a corner of element 0 and the middle of a side of element 1"
                                  : "vertex 3 is a corner of element 1 and the middle of a side of element 0");
    }
    assert_int_equal(host.live, 0);
}

static dgfem_status create_and_destroy(void *context, const dgfem_hooks *hooks) {
    dgfem_shell_desc desc = shell_desc();
    shell_grid *grid = (shell_grid *)context;
    dgfem_shell *shell;
    shell_grid_describe(grid, &desc);
    desc.hooks = *hooks;
    dgfem_status status = dgfem_shell_create(&desc, &shell);
    if (status) return status;
    dgfem_shell_surface *surface;
    dgfem_shell_surface_desc surface_desc = dgfem_default_shell_surface_desc();
    surface_desc.hooks = *hooks;
    int edges[8] = {0}, count = dgfem_shell_edges_on_plane(shell, plane_of(1, 0, 0, 0), (dgfem_real)1e-5, edges, 8);
    status = dgfem_shell_clamp(shell, edges, count, NULL);
    if (!status) status = dgfem_shell_set_pressure(shell, NULL, 0, 1, 1, NULL);
    if (!status) status = dgfem_shell_step(shell, (dgfem_real)0.01, NULL);
    if (!status) {
        status = dgfem_shell_surface_create(shell, &surface_desc, &surface);
        if (!status) dgfem_shell_surface_destroy(surface);
    }
    dgfem_shell_destroy(shell);
    return status;
}

static void survives_every_failing_allocation(void **state) {
    shell_grid grid;
    (void)state;
    for (int triangles = 0; triangles < 2; triangles++) {
        memset(&grid, 0, sizeof grid);
        assert_true(shell_grid_add(&grid, 2, 1, triangles, 0, map_flat, NULL));
        assert_true(check_every_allocation(create_and_destroy, &grid) > 10);
        shell_grid_free(&grid);
    }
}

/* ---- stiffness ---- */

/* Exactly the six rigid motions: of every connected mesh, folded and closed ones included. */
static void six_zero_modes(void **state) {
    static const shell_grid_map maps[] = {map_flat, map_curved, map_fold, map_tube};
    dgfem_shell_desc desc = shell_desc();
    (void)state;
    if (DGFEM_REAL_IS_FLOAT) return; /* bending pivots vanish in float's round-off */
    for (int k = 0; k < 9; k++) {
        dgfem_shell *shell = k == 8 ? shell_make_mixed(&desc, 0.2)
                                    : shell_make(&desc, k / 2 == 3 ? 6 : 2, k / 2 == 3 ? 1 : 2, k % 2, maps[k / 2]);
        double *dense = shell_dense(shell, 0);
        int modes = shell_zero_modes(dense, 3 * shell->node_count, 1e-11);
        assert_int_equal(modes, 6);
        free(dense);
        dgfem_shell_destroy(shell);
    }
}

/* K of a shell and of the same shell with all normals turned round are the same. */
static void stiffness_ignores_orientation(void **state) {
    static const double points[] = {0, 0, 0, 1, 0, 0, 2, 0, 0.7, 0, 1, 0.1, 1, 1, 0.2, 2, 1, 1};
    static const int up[] = {0, 1, 4, 3, 1, 2, 5, 4}, down[] = {0, 3, 4, 1, 1, 4, 5, 2};
    dgfem_shell_desc desc = shell_desc();
    dgfem_shell *shell[2];
    double *dense[2], largest = 0;
    (void)state;
    desc.vertices = dgfem_points_in_double(points, 6);
    desc.quad_count = 2;
    for (int k = 0; k < 2; k++) {
        desc.quads = k ? down : up;
        check_status(dgfem_shell_create(&desc, &shell[k]), DGFEM_OK);
        dense[k] = shell_dense(shell[k], 0);
    }
    int n = 3 * shell[0]->node_count, match[64];
    for (int i = 0; i < shell[0]->node_count; i++) {
        dgfem_vec3 x = shell[0]->rest[i];
        match[i] = shell_grid_nearest(shell[1], (double)x.x, (double)x.y, (double)x.z);
    }
    for (int i = 0; i < n * n; i++) largest = fmax(largest, fabs(dense[0][i]));
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            check_near(dense[1][(3 * match[i / 3] + i % 3) * n + 3 * match[j / 3] + j % 3], dense[0][i * n + j],
                       64 * CHECK_EPSILON * largest);
    for (int k = 0; k < 2; k++) free(dense[k]), dgfem_shell_destroy(shell[k]);
}

/* ---- strains against the exact nonlinear ones ---- */

/* First and second fundamental form of an element at (a, b), from positions alone: differences of polynomials of degree
   3 in each parameter are exact. out: a11 a22 a12 b11 b22 b12. */
static void forms_at(const dgfem_shell *shell, int e, double a, double b, double *out, double normal[3]) {
    const double h = 0.25;
    double d[5][3], x[5][5][3];
    for (int i = -2; i <= 2; i++)
        for (int j = -2; j <= 2; j++) {
            dgfem_vec3 p;
            check_status(dgfem_shell_evaluate(shell, e, (dgfem_real)(a + i * h), (dgfem_real)(b + j * h), &p, NULL),
                         DGFEM_OK);
            x[i + 2][j + 2][0] = (double)p.x, x[i + 2][j + 2][1] = (double)p.y, x[i + 2][j + 2][2] = (double)p.z;
        }
    for (int c = 0; c < 3; c++) {
        d[0][c] = (x[0][2][c] - 8 * x[1][2][c] + 8 * x[3][2][c] - x[4][2][c]) / (12 * h);
        d[1][c] = (x[2][0][c] - 8 * x[2][1][c] + 8 * x[2][3][c] - x[2][4][c]) / (12 * h);
        d[2][c] = (x[1][2][c] - 2 * x[2][2][c] + x[3][2][c]) / (h * h);
        d[3][c] = (x[2][1][c] - 2 * x[2][2][c] + x[2][3][c]) / (h * h);
        d[4][c] = (x[3][3][c] - x[3][1][c] - x[1][3][c] + x[1][1][c]) / (4 * h * h);
    }
    double n[3], length;
    for (int c = 0; c < 3; c++) n[c] = d[0][(c + 1) % 3] * d[1][(c + 2) % 3] - d[0][(c + 2) % 3] * d[1][(c + 1) % 3];
    length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    for (int k = 0; k < 6; k++) out[k] = 0;
    for (int c = 0; c < 3; c++) {
        normal[c] = n[c] / length;
        out[0] += d[0][c] * d[0][c], out[1] += d[1][c] * d[1][c], out[2] += d[0][c] * d[1][c];
        for (int k = 0; k < 3; k++) out[3 + k] += d[2 + k][c] * normal[c];
    }
}

/* Components along the axes f1, f2 of a covariant symmetric tensor t11 t22 t12; g the metric a11 a22 a12, and f1 along
   the first base vector. */
static void on_axes(const double *g, const double *t, double *out) {
    double root = sqrt(g[0]), j = sqrt(g[0] * g[1] - g[2] * g[2]);
    double p1 = 1 / root, q1 = -g[2] / (root * j), q2 = root / j; /* f1 = p1 e1; f2 = q1 e1 + q2 e2 */
    out[0] = p1 * p1 * t[0];
    out[1] = q1 * q1 * t[0] + q2 * q2 * t[1] + 2 * q1 * q2 * t[2];
    out[2] = p1 * q1 * t[0] + p1 * q2 * t[2];
}

static void strains_are_derivatives_of_the_exact_ones(void **state) {
    check_random random = check_random_seeded(61);
    dgfem_shell_desc desc = shell_desc();
    (void)state;
    desc.corotational = 0;
    for (int triangles = 0; triangles < 2; triangles++) {
        dgfem_shell *shell = shell_make(&desc, 2, 2, triangles, map_curved);
        dgfem_vec3 *u = (dgfem_vec3 *)calloc((size_t)shell->node_count, sizeof *u);
        for (int i = 0; i < shell->node_count; i++) u[i] = check_random_vec3(&random, -0.5, 0.5);
        for (int e = 0; e < shell->element_count; e++) {
            double f[3][6], n[3], membrane[3], bending[3], rest[3], expect[6];
            double a = check_random_real(&random, 0, 0.5), b = check_random_real(&random, 0, 0.5);
            for (int k = 0; k < 3; k++) {
                for (int i = 0; i < shell->node_count; i++) {
                    double s = k == 0 ? 0 : k == 1 ? -STEP : STEP;
                    shell->position[i] = at3((double)shell->rest[i].x + s * (double)u[i].x,
                                             (double)shell->rest[i].y + s * (double)u[i].y,
                                             (double)shell->rest[i].z + s * (double)u[i].z);
                }
                forms_at(shell, e, a, b, f[k], n);
            }
            for (int k = 0; k < 3; k++) {
                rest[k] = f[0][k];
                membrane[k] = (f[2][k] - f[1][k]) / (4 * STEP);
                bending[k] = -(f[2][3 + k] - f[1][3 + k]) / (2 * STEP);
            }
            on_axes(rest, membrane, expect);
            on_axes(rest, bending, expect + 3);
            for (int i = 0; i < shell->node_count; i++)
                shell->position[i] =
                    at3((double)shell->rest[i].x + (double)u[i].x, (double)shell->rest[i].y + (double)u[i].y,
                        (double)shell->rest[i].z + (double)u[i].z);
            dgfem_shell_strain strain;
            check_status(dgfem_shell_strain_at(shell, e, (dgfem_real)a, (dgfem_real)b, &strain), DGFEM_OK);
            double size = 0;
            for (int k = 0; k < 6; k++) size = fmax(size, fabs(expect[k]));
            for (int k = 0; k < 3; k++) {
                check_near(strain.membrane[k], expect[k], (DGFEM_REAL_IS_FLOAT ? 2e-2 : 1e-7) * size);
                check_near(strain.bending[k], expect[3 + k], (DGFEM_REAL_IS_FLOAT ? 2e-2 : 1e-7) * size);
            }
        }
        free(u);
        dgfem_shell_destroy(shell);
    }
}

/* ---- patch tests ---- */

static dgfem_vec3 map_skewed(void *user, double u, double v) {
    double x = u + 0.1 * sin(5 * v) * u * (1 - u), y = v + 0.12 * sin(4 * u) * v * (1 - v);
    (void)user;
    return at3(x, y, 0);
}

/* Sets all boundary nodes to `field` of their rest place, solves, and compares everywhere. */
static void solve_patch(dgfem_shell *shell, dgfem_vec3 (*field)(dgfem_vec3), double tolerance) {
    dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
    int count, *nodes = shell_boundary_nodes(shell, &count);
    for (int i = 0; i < count; i++)
        check_status(dgfem_shell_fix_nodes(shell, &nodes[i], 1, DGFEM_SHELL_XYZ, field(shell->rest[nodes[i]]), NULL),
                     DGFEM_OK);
    check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_OK);
    for (int i = 0; i < shell->node_count; i++) {
        dgfem_vec3 u = field(shell->rest[i]), x = shell->rest[i];
        check_near3(shell->position[i], at3((double)(x.x + u.x), (double)(x.y + u.y), (double)(x.z + u.z)), tolerance);
    }
    free(nodes);
}

static dgfem_vec3 stretch(dgfem_vec3 x) {
    return at3(0.01 * (double)x.x + 0.02 * (double)x.y, -0.005 * (double)x.x + 0.015 * (double)x.y, 0);
}

/* Interior nodes off the straight lines between their corners: curved sides in the plane. */
static void constant_membrane_strain_on_any_mesh(void **state) {
    (void)state;
    for (int corotational = 0; corotational < 2; corotational++)
        for (int kind = 0; kind < 3; kind++) {
            dgfem_shell_desc desc = shell_desc();
            desc.corotational = corotational;
            dgfem_shell *shell = kind == 2 ? shell_make_mixed(&desc, 0) : shell_make(&desc, 3, 3, kind, map_skewed);
            solve_patch(shell, stretch, 2e4 * CHECK_EPSILON);
            dgfem_shell_strain strain;
            check_status(dgfem_shell_strain_at(shell, 1, (dgfem_real)0.2, (dgfem_real)0.3, &strain), DGFEM_OK);
            check_near(strain.membrane[0] + strain.membrane[1], 0.025, corotational ? 1e-3 : 1e5 * CHECK_EPSILON);
            dgfem_shell_destroy(shell);
        }
}

static dgfem_vec3 bend(dgfem_vec3 x) { return at3(0, 0, 0.05 * (double)(x.x * x.x)); }

/* w = k x^2 / 2 on a square: the boundary keeps its slopes, constant along each side. */
static void constant_curvature(void **state) {
    static const double points[] = {0, 0, 0,   0.4, 0, 0, 1, 0,   0, 0, 0.6, 0, 0.55, 0.35,
                                    0, 1, 0.5, 0,   0, 1, 0, 0.5, 1, 0, 1,   1, 0};
    static const int faces[] = {0, 1, 4, 0, 4, 3, 1, 2, 5, 1, 5, 4, 3, 4, 7, 3, 7, 6, 4, 5, 8, 4, 8, 7};
    (void)state;
    for (int quads = 0; quads < 2; quads++) {
        dgfem_shell_desc desc = shell_desc();
        dgfem_shell *shell;
        int edges[256], count;
        desc.corotational = 0;
        if (quads) {
            shell = shell_make(&desc, 3, 2, 0, map_flat);
        } else {
            desc.vertices = dgfem_points_in_double(points, 9);
            desc.triangles = faces, desc.triangle_count = 8;
            check_status(dgfem_shell_create(&desc, &shell), DGFEM_OK);
        }
        for (int axis = 0; axis < 2; axis++)
            for (int end = 0; end < 2; end++) {
                count = shell_edges(shell, plane_of(axis == 0, axis == 1, 0, end), edges);
                check_status(
                    dgfem_shell_fix_rotation(shell, edges, count, (dgfem_real)(axis == 0 && end ? -0.1 : 0), NULL),
                    DGFEM_OK);
            }
        solve_patch(shell, bend, 1e5 * CHECK_EPSILON);
        dgfem_shell_strain strain;
        check_status(dgfem_shell_strain_at(shell, 0, (dgfem_real)0.2, (dgfem_real)0.3, &strain), DGFEM_OK);
        check_near(strain.bending[0] + strain.bending[1], -0.1, 1e6 * CHECK_EPSILON);
        dgfem_shell_destroy(shell);
    }
}

/* ---- rotations ---- */

static dgfem_mat3 turn(double x, double y, double z, double angle) {
    dgfem_mat3 r;
    double c = cos(angle), s = sin(angle), length = sqrt(x * x + y * y + z * z), a[3];
    a[0] = x / length, a[1] = y / length, a[2] = z / length;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) r.m[i][j] = (dgfem_real)((1 - c) * a[i] * a[j] + (i == j ? c : 0));
    for (int i = 0; i < 3; i++) {
        r.m[(i + 2) % 3][(i + 1) % 3] += (dgfem_real)(s * a[i]);
        r.m[(i + 1) % 3][(i + 2) % 3] -= (dgfem_real)(s * a[i]);
    }
    return r;
}

static dgfem_vec3 apply(const dgfem_mat3 *r, dgfem_vec3 v) {
    return at3((double)(r->m[0][0] * v.x + r->m[0][1] * v.y + r->m[0][2] * v.z),
               (double)(r->m[1][0] * v.x + r->m[1][1] * v.y + r->m[1][2] * v.z),
               (double)(r->m[2][0] * v.x + r->m[2][1] * v.y + r->m[2][2] * v.z));
}

static void rigid_motion_gives_no_force(void **state) {
    static const shell_grid_map maps[] = {map_flat, map_curved, map_fold, map_tube};
    check_random random = check_random_seeded(62);
    dgfem_shell_desc desc = shell_desc();
    (void)state;
    for (int k = 0; k < 8; k++) {
        dgfem_shell *shell = shell_make(&desc, 6, 2, k % 2, maps[k / 2]);
        dgfem_mat3 r = turn(check_random_real(&random, -1, 1), check_random_real(&random, -1, 1), 1,
                            check_random_real(&random, -3.1, 3.1));
        dgfem_vec3 *force = (dgfem_vec3 *)calloc((size_t)shell->node_count, sizeof *force);
        for (int i = 0; i < shell->node_count; i++) {
            dgfem_vec3 x = apply(&r, shell->rest[i]);
            shell->position[i] = at3((double)x.x + 3, (double)x.y - 2, (double)x.z + 5);
        }
        check_status(dgfem_shell_internal_force(shell, force), DGFEM_OK);
        /* E h L is some 300 N here */
        check_near(shell_largest(force, shell->node_count), 0, 300 * 4500 * CHECK_EPSILON);
        free(force);
        dgfem_shell_destroy(shell);
    }
}

/* All kinds of supports, too. */
static void tangent_is_the_derivative_of_the_force(void **state) {
    check_random random = check_random_seeded(63);
    (void)state;
    for (int k = 0; k < 4; k++) {
        dgfem_shell_desc desc = shell_desc();
        dgfem_shell *shell = shell_make(&desc, 3, 2, k % 2, map_curved);
        int n = shell->node_count, edges[64], starts[65];
        size_t bytes = (size_t)n * sizeof(dgfem_vec3);
        dgfem_vec3 *x = (dgfem_vec3 *)malloc(bytes), *d = (dgfem_vec3 *)malloc(bytes), *t = (dgfem_vec3 *)malloc(bytes);
        dgfem_vec3 *f[2];
        dgfem_shell_boundary(shell, edges, starts);
        if (k >= 2) {
            check_status(dgfem_shell_clamp(shell, edges, 2, NULL), DGFEM_OK);
            check_status(dgfem_shell_fix_symmetry(shell, edges + 2, 2, at3(0.3, 0.1, -0.5), NULL), DGFEM_OK);
            check_status(dgfem_shell_fix_rotation(shell, edges + 4, 1, (dgfem_real)0.3, NULL), DGFEM_OK);
        }
        for (int i = 0; i < n; i++) {
            dgfem_vec3 noise = check_random_vec3(&random, -0.1, 0.1), r = shell->rest[i];
            x[i] = at3((double)(r.x + noise.x), (double)(r.y + noise.y), (double)(r.z + noise.z));
            d[i] = check_random_vec3(&random, -1, 1);
        }
        for (int s = 0; s < 2; s++) {
            double step = (s ? 1 : -1) * (DGFEM_REAL_IS_FLOAT ? 1e-3 : 1e-6);
            f[s] = (dgfem_vec3 *)malloc(bytes);
            for (int i = 0; i < n; i++)
                shell->position[i] = at3((double)x[i].x + step * (double)d[i].x, (double)x[i].y + step * (double)d[i].y,
                                         (double)x[i].z + step * (double)d[i].z);
            check_status(dgfem_shell_internal_force(shell, f[s]), DGFEM_OK);
        }
        check_status(dgfem_shell_set_positions(shell, dgfem_points_in_vec3(x, n)), DGFEM_OK);
        check_status(dgfem_shell_tangent_multiply(shell, d, t), DGFEM_OK);
        double tolerance = (DGFEM_REAL_IS_FLOAT ? 2e-3 : 1e-6) * shell_largest(t, n);
        double twice = DGFEM_REAL_IS_FLOAT ? 2e-3 : 2e-6;
        for (int i = 0; i < n; i++)
            check_near3(t[i],
                        at3(((double)f[1][i].x - (double)f[0][i].x) / twice,
                            ((double)f[1][i].y - (double)f[0][i].y) / twice,
                            ((double)f[1][i].z - (double)f[0][i].z) / twice),
                        tolerance);
        free(f[0]), free(f[1]), free(x), free(d), free(t);
        dgfem_shell_destroy(shell);
    }
}

/* The assembled matrix is the symmetric part of the tangent. */
static void matrix_is_the_symmetric_tangent(void **state) {
    check_random random = check_random_seeded(64);
    dgfem_shell_desc desc = shell_desc();
    dgfem_shell *shell = shell_make_mixed(&desc, 0.2);
    int n = shell->node_count;
    dgfem_vec3 u[64], v[64], ku[64], kv[64], mu[64];
    const dgfem_matrix *matrix;
    double exact = 0, matrix_value = 0, size = 0;
    (void)state;
    assert_true(n <= 64);
    for (int i = 0; i < n; i++) {
        dgfem_vec3 noise = check_random_vec3(&random, -0.05, 0.05);
        shell->position[i] = at3((double)(shell->rest[i].x + noise.x), (double)(shell->rest[i].y + noise.y),
                                 (double)(shell->rest[i].z + noise.z));
        u[i] = check_random_vec3(&random, -1, 1);
        v[i] = check_random_vec3(&random, -1, 1);
    }
    check_status(dgfem_shell_tangent_multiply(shell, u, ku), DGFEM_OK);
    check_status(dgfem_shell_tangent_multiply(shell, v, kv), DGFEM_OK);
    check_status(dgfem_shell_stiffness(shell, 1, &matrix), DGFEM_OK);
    dgfem_matrix_multiply(matrix, (const dgfem_real *)(const void *)u, (dgfem_real *)(void *)mu);
    for (int i = 0; i < n; i++) {
        exact += 0.5 * (double)(ku[i].x * v[i].x + ku[i].y * v[i].y + ku[i].z * v[i].z);
        exact += 0.5 * (double)(kv[i].x * u[i].x + kv[i].y * u[i].y + kv[i].z * u[i].z);
        matrix_value += (double)(mu[i].x * v[i].x + mu[i].y * v[i].y + mu[i].z * v[i].z);
        size += fabs((double)ku[i].x) + fabs((double)ku[i].y) + fabs((double)ku[i].z);
    }
    check_near(matrix_value, exact, 64 * CHECK_EPSILON * size);
    dgfem_shell_destroy(shell);
}

/* ---- static solves ---- */

static dgfem_vec3 map_strip(void *user, double u, double v) {
    (void)user;
    return at3(10 * u, v, 0);
}

static dgfem_shell *make_strip(int n, int triangles, int corotational) {
    dgfem_shell_desc desc = shell_desc();
    int edges[256];
    desc.material.young = (dgfem_real)1.2e6;
    desc.material.poisson = 0;
    desc.corotational = corotational;
    dgfem_shell *shell = shell_make(&desc, n, 1, triangles, map_strip);
    check_status(dgfem_shell_clamp(shell, edges, shell_edges(shell, plane_of(1, 0, 0, 0), edges), NULL), DGFEM_OK);
    return shell;
}

/* Small load: P L^3 / (3 E I) with E I = 100. */
static void strip_bends_as_a_beam(void **state) {
    (void)state;
    for (int triangles = 0; triangles < 2; triangles++) {
        dgfem_shell *shell = make_strip(8, triangles, 0);
        dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
        int edges[256], count = shell_edges(shell, plane_of(1, 0, 0, 10), edges),
                        tip = shell_grid_nearest(shell, 10, 0, 0);
        check_status(dgfem_shell_set_line_load(shell, edges, count, at3(0, 0, 0.3), NULL), DGFEM_OK);
        check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_OK);
        check_near(shell->position[tip].z, 1, DGFEM_REAL_IS_FLOAT ? 0.02 : 0.005);
        dgfem_shell_destroy(shell);
    }
}

/* Sze, Liu and Lo (2004): 6.698 up, 3.286 back. */
static void strip_under_large_end_shear(void **state) {
    (void)state;
    if (DGFEM_REAL_IS_FLOAT) return; /* thickness 1/100 of the length */
    for (int triangles = 0; triangles < 2; triangles++) {
        dgfem_shell *shell = make_strip(16, triangles, 1);
        dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
        dgfem_shell_info info;
        int edges[256], count = shell_edges(shell, plane_of(1, 0, 0, 10), edges),
                        tip = shell_grid_nearest(shell, 10, 0, 0);
        check_status(dgfem_shell_set_line_load(shell, edges, count, at3(0, 0, 4), NULL), DGFEM_OK);
        how.load_steps = 4;
        check_status(dgfem_shell_solve_static(shell, &how, &info), DGFEM_OK);
        check_near(shell->position[tip].z, 6.698, 0.003 * 6.698);
        check_near(shell->position[tip].x, 10 - 3.286, 0.003 * 3.286);
        assert_true(info.iterations < 40);
        dgfem_shell_destroy(shell);
    }
}

/* A cantilever of two halves that differ in thickness, material, or both, clamped at x = 0. */
static const double stepped_half = 1;

static dgfem_vec3 map_stepped(void *user, double u, double v) {
    (void)user;
    return at3(2 * stepped_half * u, v, 0);
}

static dgfem_shell *make_stepped(int n, int triangles, const double h[2], const double young[2]) {
    dgfem_shell_desc desc = shell_desc();
    dgfem_real thickness[64];
    dgfem_material material[64];
    dgfem_shell *shell;
    shell_grid grid;
    int edges[256], per = triangles ? 2 : 1;
    desc.corotational = 0;
    memset(&grid, 0, sizeof grid);
    assert_true(n * per <= 64);
    assert_true(shell_grid_add(&grid, n, 1, triangles, 1e-4, map_stepped, NULL));
    shell_grid_describe(&grid, &desc);
    for (int e = 0; e < n * per; e++) {
        int outer = e / per >= n / 2;
        thickness[e] = (dgfem_real)h[outer];
        material[e] = desc.material;
        material[e].young = (dgfem_real)young[outer];
        material[e].poisson = 0;
    }
    desc.thicknesses = thickness, desc.materials = material;
    check_status(dgfem_shell_create(&desc, &shell), DGFEM_OK);
    shell_grid_free(&grid);
    check_status(dgfem_shell_clamp(shell, edges, shell_edges(shell, plane_of(1, 0, 0, 0), edges), NULL), DGFEM_OK);
    return shell;
}

static const double stepped_thickness[3][2] = {{0.2, 0.1}, {0.2, 0.2}, {0.1, 0.2}};
static const double stepped_young[3][2] = {{1.5e5, 1.5e5}, {1.5e5, 4e5}, {1.5e5, 5e5}};

static double stepped_bending(int kind, int outer) {
    double h = stepped_thickness[kind][outer];
    return stepped_young[kind][outer] * h * h * h / 12;
}

/* Tip of n elements under the end force P, over that of two beams, w = P / 3 ((L^3 - l^3) / B_inner + l^3 / B_outer),
   l = L / 2. */
static double stepped_tip(int kind, int n, int triangles) {
    dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
    int edges[256];
    dgfem_shell *shell = make_stepped(n, triangles, stepped_thickness[kind], stepped_young[kind]);
    int count = shell_edges(shell, plane_of(1, 0, 0, 2), edges), tip = shell_grid_nearest(shell, 2, 0, 0);
    check_status(dgfem_shell_set_line_load(shell, edges, count, at3(0, 0, 1), NULL), DGFEM_OK);
    check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_OK);
    double expect = 1.0 / 3 * ((8 - 1) / stepped_bending(kind, 0) + 1 / stepped_bending(kind, 1));
    double tip_height = (double)shell->position[tip].z / expect;
    dgfem_shell_destroy(shell);
    return tip_height;
}

/* Within 1 % on eight elements, and more than three times as near on sixteen. */
static void stepped_cantilever_under_a_force(void **state) {
    (void)state;
    if (DGFEM_REAL_IS_FLOAT) return; /* round-off of sixteen elements in a row: 15 % */
    for (int triangles = 0; triangles < 2; triangles++)
        for (int kind = 0; kind < 3; kind++) {
            double coarse = stepped_tip(kind, 8, triangles) - 1, fine = stepped_tip(kind, 16, triangles) - 1;
            check_near(coarse, 0, 0.01);
            check_near(fine, 0, 0.3 * fabs(coarse));
        }
}

/* Under an end moment and under tension curvature and strain are constant in each half: nothing is lost. */
static void stepped_cantilever_under_moment_and_tension(void **state) {
    (void)state;
    for (int k = 0; k < 6; k++) {
        int kind = k / 2, edges[256];
        const double *h = stepped_thickness[kind], *young = stepped_young[kind];
        double b0 = stepped_bending(kind, 0), b1 = stepped_bending(kind, 1);
        dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
        dgfem_shell *shell = make_stepped(4, k % 2, h, young);
        int count = shell_edges(shell, plane_of(1, 0, 0, 2), edges);
        check_status(dgfem_shell_set_moment(shell, edges, count, -10, 0, NULL), DGFEM_OK);
        check_status(dgfem_shell_set_line_load(shell, edges, count, at3(300, 0, 0), NULL), DGFEM_OK);
        check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_OK);
        for (int i = 0; i < shell->node_count; i++) {
            double x = (double)shell->rest[i].x, in = fmin(x, stepped_half), out = fmax(x - stepped_half, 0);
            double w = 10 * (in * in / (2 * b0) + in * out / b0 + out * out / (2 * b1));
            double u = 300 * (in / (young[0] * h[0]) + out / (young[1] * h[1]));
            check_near(shell->position[i].z, w, (DGFEM_REAL_IS_FLOAT ? 2e-2 : 1e-10) * 1.2);
            check_near((double)shell->position[i].x - x, u, 1e3 * CHECK_EPSILON);
        }
        dgfem_shell_destroy(shell);
    }
}

static dgfem_vec3 map_strip_far(void *user, double u, double v) {
    dgfem_vec3 x = map_strip(user, u, v);
    return at3((double)x.x + 1e4, (double)x.y - 1e4, (double)x.z);
}

/* Far from the origin round-off is larger, and convergence ends there. */
static void strip_bends_far_from_the_origin(void **state) {
    double tips[2];
    (void)state;
    if (DGFEM_REAL_IS_FLOAT) return;
    for (int far = 0; far < 2; far++) {
        dgfem_shell_desc desc = shell_desc();
        dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
        int edges[256];
        desc.material.young = (dgfem_real)1.2e6;
        desc.material.poisson = 0;
        dgfem_shell *shell = shell_make(&desc, 8, 1, 0, far ? map_strip_far : map_strip);
        double x = far ? 1e4 : 0;
        int tip = shell_grid_nearest(shell, x + 10, -x, 0);
        int count = shell_edges(shell, plane_of(1, 0, 0, x), edges);
        check_status(dgfem_shell_clamp(shell, edges, count, NULL), DGFEM_OK);
        count = shell_edges(shell, plane_of(1, 0, 0, x + 10), edges);
        check_status(dgfem_shell_set_line_load(shell, edges, count, at3(0, 0, 4), NULL), DGFEM_OK);
        check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_OK);
        tips[far] = (double)shell->position[tip].z;
        dgfem_shell_destroy(shell);
    }
    check_near(tips[1], tips[0], 1e-5);
}

/* Where rotations are not followed, pressure and moments that follow are dead loads. */
static void linear_shells_have_dead_loads(void **state) {
    dgfem_vec3 tips[2];
    (void)state;
    for (int follower = 0; follower < 2; follower++) {
        dgfem_shell *shell = make_strip(4, 0, 0);
        dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
        int edges[256], count = shell_edges(shell, plane_of(1, 0, 0, 10), edges);
        check_status(dgfem_shell_set_pressure(shell, NULL, 0, 1, follower, NULL), DGFEM_OK);
        check_status(dgfem_shell_set_moment(shell, edges, count, 5, follower, NULL), DGFEM_OK);
        check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_OK);
        check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_OK); /* from the bent shape */
        tips[follower] = shell->position[shell_grid_nearest(shell, 10, 0, 0)];
        dgfem_shell_destroy(shell);
    }
    check_near3(tips[1], tips[0], DGFEM_REAL_IS_FLOAT ? 0.02 : 1e-8);
}

/* E I 2 pi / L rolls the strip up to a circle. */
static void strip_rolls_up(void **state) {
    dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
    int edges[256], id;
    (void)state;
    if (DGFEM_REAL_IS_FLOAT) return;
    dgfem_shell *shell = make_strip(16, 0, 1);
    int count = shell_edges(shell, plane_of(1, 0, 0, 10), edges), tip = shell_grid_nearest(shell, 10, 0, 0);
    check_status(dgfem_shell_set_moment(shell, edges, count, (dgfem_real)(-10 * 3.14159265358979), 1, &id), DGFEM_OK);
    how.load_steps = 6;
    check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_OK); /* half a circle */
    check_near(shell->position[tip].x, 0, 0.02);
    check_near(shell->position[tip].z, 20 / 3.14159265358979, 0.02);
    check_status(dgfem_shell_change_load(shell, id, at3(0, 0, 0), (dgfem_real)(-20 * 3.14159265358979)), DGFEM_OK);
    check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_OK);
    check_near(shell->position[tip].x, 0, 0.01);
    check_near(shell->position[tip].z, 0, 0.01);
    dgfem_shell_destroy(shell);
}

/* Frozen rotations reach the same equilibrium, more slowly. */
static void fixed_point_agrees_with_newton(void **state) {
    dgfem_vec3 tips[2];
    dgfem_shell_info info[2];
    (void)state;
    for (int frozen = 0; frozen < 2; frozen++) {
        dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
        dgfem_shell_desc desc = shell_desc();
        int edges[256];
        dgfem_shell *shell = shell_make(&desc, 3, 1, 0, map_flat);
        int tip = shell_grid_nearest(shell, 1, 0, 0);
        check_status(dgfem_shell_clamp(shell, edges, shell_edges(shell, plane_of(1, 0, 0, 0), edges), NULL), DGFEM_OK);
        check_status(dgfem_shell_set_line_load(shell, edges, shell_edges(shell, plane_of(1, 0, 0, 1), edges),
                                               at3(0, 0, 0.15), NULL),
                     DGFEM_OK);
        how.frozen = frozen;
        how.max_iterations = 200;
        how.tolerance = (dgfem_real)(DGFEM_REAL_IS_FLOAT ? 1e-3 : 1e-7);
        check_status(dgfem_shell_solve_static(shell, &how, &info[frozen]), DGFEM_OK);
        tips[frozen] = shell->position[tip];
        dgfem_shell_destroy(shell);
    }
    assert_true((double)tips[0].z > 0.3);
    check_near3(tips[1], tips[0], DGFEM_REAL_IS_FLOAT ? 0.01 : 1e-5);
    assert_true(info[1].iterations > info[0].iterations);
}

/* Euler's column, clamped at one end: it stands up to E I (pi / 2 L)^2 and no longer. */
static void column_loses_stability_at_eulers_load(void **state) {
    const double euler = 100 * 3.14159265 * 3.14159265 / 400;
    dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
    int edges[256], id, stable;
    (void)state;
    if (DGFEM_REAL_IS_FLOAT) return;
    dgfem_shell *shell = make_strip(8, 0, 1);
    int count = shell_edges(shell, plane_of(1, 0, 0, 10), edges);
    check_status(dgfem_shell_set_line_load(shell, edges, count, at3(-0.98 * euler, 0, 0), &id), DGFEM_OK);
    check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_OK);
    check_status(dgfem_shell_is_stable(shell, &stable), DGFEM_OK);
    assert_true(stable);
    check_status(dgfem_shell_change_load(shell, id, at3(-1.02 * euler, 0, 0), 0), DGFEM_OK);
    (void)dgfem_shell_solve_static(shell, &how, NULL); /* straight on, or off to a side */
    check_status(dgfem_shell_is_stable(shell, &stable), DGFEM_OK);
    double bent = fabs((double)shell->position[shell_grid_nearest(shell, 10, 0, 0)].z);
    assert_true(!stable || bent > 0.1);
    dgfem_shell_destroy(shell);
}

/* A balloon: a tube closed by symmetry planes, of radius 1, under a follower pressure p has the hoop force p R. */
static void pressure_stretches_a_tube(void **state) {
    dgfem_shell_desc desc = shell_desc();
    dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
    int edges[256], node = 0;
    (void)state;
    desc.material.poisson = 0;
    dgfem_shell *shell = shell_make(&desc, 8, 1, 0, map_tube);
    for (int end = 0; end < 2; end++)
        check_status(dgfem_shell_fix_symmetry(shell, edges, shell_edges(shell, plane_of(0, 0, 1, 2 * end), edges),
                                              at3(0, 0, 1), NULL),
                     DGFEM_OK);
    check_status(dgfem_shell_fix_nodes(shell, &node, 1, DGFEM_SHELL_Y, at3(0, 0, 0), NULL), DGFEM_OK);
    int opposite = shell_grid_nearest(shell, -1, 0, 0);
    check_status(dgfem_shell_fix_nodes(shell, &opposite, 1, DGFEM_SHELL_Y, at3(0, 0, 0), NULL), DGFEM_OK);
    int side = shell_grid_nearest(shell, 0, 1, 0);
    check_status(dgfem_shell_fix_nodes(shell, &side, 1, DGFEM_SHELL_X, at3(0, 0, 0), NULL), DGFEM_OK);
    check_status(dgfem_shell_set_pressure(shell, NULL, 0, 5, 1, NULL), DGFEM_OK);
    check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_OK);
    /* E h e = p (1 + e): 100 e = 5 (1 + e) */
    double x = (double)(shell->position[node].x - shell->position[opposite].x) / 2;
    check_near(x - 1, 5.0 / 95, 2e-3);
    dgfem_shell_destroy(shell);
}

/* A clamp that turns by a right angle in three steps takes a free strip along rigidly. */
static void moving_clamp_carries_the_shell(void **state) {
    dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
    int edges[256], id;
    (void)state;
    dgfem_shell_desc desc = shell_desc();
    dgfem_shell *shell = shell_make(&desc, 3, 2, 1, map_flat);
    int tip = shell_grid_nearest(shell, 1, 1, 0);
    check_status(dgfem_shell_clamp(shell, edges, shell_edges(shell, plane_of(1, 0, 0, 0), edges), &id), DGFEM_OK);
    for (int k = 1; k <= 3; k++) {
        check_status(dgfem_shell_move_clamp(shell, id, turn(0, 1, 0, -0.5235987755982988 * k), at3(k, 0, 0)), DGFEM_OK);
        check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_OK);
    }
    check_near3(shell->position[tip], at3(3, 1, 1), 5e4 * CHECK_EPSILON);
    dgfem_shell_destroy(shell);
}

/* One clamp that turns by a large angle about an axis away from the strip takes it along rigidly, in load steps of one
   solve: between the placements lies a screw, so that nothing is stretched on the way. */
static void load_steps_turn_a_clamp(void **state) {
    static const double degrees[] = {80, 170, 180};
    (void)state;
    if (DGFEM_REAL_IS_FLOAT) return; /* thickness 1/100 of the length */
    for (int k = 0; k < 3; k++) {
        dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
        dgfem_shell_info info;
        int edges[256], id;
        dgfem_shell_desc desc = shell_desc();
        dgfem_shell *shell = shell_make(&desc, 8, 1, 0, map_strip);
        dgfem_mat3 r = turn(0.1, 1, 0.2, degrees[k] * 3.14159265358979 / 180);
        dgfem_vec3 shift = apply(&r, at3(-3, 4, 5)); /* x -> r (x - c) + c, and along the axis */
        check_status(dgfem_shell_clamp(shell, edges, shell_edges(shell, plane_of(1, 0, 0, 0), edges), &id), DGFEM_OK);
        check_status(
            dgfem_shell_move_clamp(shell, id, r, at3((double)shift.x + 3, (double)shift.y - 4, (double)shift.z - 5)),
            DGFEM_OK);
        how.load_steps = 6;
        check_status(dgfem_shell_solve_static(shell, &how, &info), DGFEM_OK);
        assert_int_equal(info.load_steps, 6); /* none had to be halved */
        for (int i = 0; i < shell->node_count; i++) {
            dgfem_vec3 x = apply(&r, shell->rest[i]);
            check_near3(shell->position[i],
                        at3((double)(x.x + shift.x) + 3, (double)(x.y + shift.y) - 4, (double)(x.z + shift.z) - 5),
                        1e-6);
        }
        dgfem_shell_destroy(shell);
    }
}

/* A strip between two clamps is rolled up: turning the one by w while it moves to the end of the arc that the strip
   then is. In one solve by 80 degrees; in six by 180; then by a whole turn. Its moment is E I w / L. */
static void clamps_roll_a_strip(void **state) {
    static const double degrees[] = {80, 180, 360};
    static const int solves[] = {1, 6, 12};
    (void)state;
    if (DGFEM_REAL_IS_FLOAT) return;
    for (int k = 0; k < 3; k++) {
        dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
        dgfem_shell_strain strain;
        int edges[256], id;
        dgfem_shell *shell = make_strip(16, 0, 1);
        check_status(dgfem_shell_clamp(shell, edges, shell_edges(shell, plane_of(1, 0, 0, 10), edges), &id), DGFEM_OK);
        how.load_steps = 4;
        double w = 0;
        for (int solve = 1; solve <= solves[k]; solve++) {
            w = degrees[k] * 3.14159265358979 / 180 * solve / solves[k];
            dgfem_mat3 r = turn(0, -1, 0, w);
            dgfem_vec3 end = apply(&r, at3(10, 0, 0));
            check_status(
                dgfem_shell_move_clamp(shell, id, r,
                                       at3(10 * sin(w) / w - (double)end.x, 0, 10 * (1 - cos(w)) / w - (double)end.z)),
                DGFEM_OK);
            check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_OK);
        }
        for (int i = 0; i < shell->node_count; i++) {
            double s = (double)shell->rest[i].x / 10;
            check_near3(shell->position[i],
                        at3(10 * sin(w * s) / w, (double)shell->rest[i].y, 10 * (1 - cos(w * s)) / w), 0.01);
        }
        check_status(dgfem_shell_strain_at(shell, 8, 0, 0, &strain), DGFEM_OK);
        check_near((double)strain.moment[0] / (100 * w / 10), -1, 0.01);
        dgfem_shell_destroy(shell);
    }
}

/* A stiff pin that is dragged far goes there in the load steps of one solve; one that is set on a bent shell changes
   nothing. */
static void load_steps_drag_a_pin(void **state) {
    dgfem_shell_desc desc = shell_desc();
    dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
    dgfem_shell_info info;
    int edges[256], pin;
    (void)state;
    if (DGFEM_REAL_IS_FLOAT) return;
    desc.material.young = (dgfem_real)1.2e6;
    desc.material.poisson = 0;
    dgfem_shell *shell = shell_make(&desc, 8, 1, 0, map_flat);
    dgfem_vec3 place = at3(0.6, 0.5, 0.7), *force = (dgfem_vec3 *)calloc((size_t)shell->node_count, sizeof *force);
    int tip = shell_grid_nearest(shell, 1, 0.5, 0);
    check_status(dgfem_shell_clamp(shell, edges, shell_edges(shell, plane_of(1, 0, 0, 0), edges), NULL), DGFEM_OK);
    check_status(dgfem_shell_pin(shell, tip, 1e4, &pin), DGFEM_OK);
    check_status(dgfem_shell_drag(shell, pin, place), DGFEM_OK);
    how.load_steps = 32;
    check_status(dgfem_shell_solve_static(shell, &how, &info), DGFEM_OK);
    assert_int_equal(info.load_steps, 32); /* none had to be halved */
    check_status(dgfem_shell_internal_force(shell, force), DGFEM_OK);
    dgfem_vec3 x = shell->position[tip];
    check_near3(force[tip],
                at3(1e4 * (double)(place.x - x.x), 1e4 * (double)(place.y - x.y), 1e4 * (double)(place.z - x.z)), 1e-3);
    assert_true(fabs((double)force[tip].z) > 10);
    check_status(dgfem_shell_remove_condition(shell, pin), DGFEM_OK);
    check_status(dgfem_shell_add_force(shell, &tip, 1, force[tip], NULL), DGFEM_OK);
    check_status(dgfem_shell_pin(shell, tip, 1e4, NULL), DGFEM_OK);
    how.load_steps = 1;
    check_status(dgfem_shell_step(shell, (dgfem_real)1e-6, NULL), DGFEM_OK); /* the force is no news to the solve */
    check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_OK);
    check_near3(shell->position[tip], x, 1e-6);
    free(force);
    dgfem_shell_destroy(shell);
}

/* Sum of the external forces, and of their moments about the origin. */
static void resultants(const dgfem_shell *shell, double *force, double *moment) {
    dgfem_vec3 *f = (dgfem_vec3 *)calloc((size_t)shell->node_count, sizeof *f);
    check_status(dgfem_shell_external_force(shell, f), DGFEM_OK);
    for (int k = 0; k < 3; k++) force[k] = moment[k] = 0;
    for (int i = 0; i < shell->node_count; i++) {
        double x[3] = {(double)shell->position[i].x, (double)shell->position[i].y, (double)shell->position[i].z};
        double g[3] = {(double)f[i].x, (double)f[i].y, (double)f[i].z};
        for (int k = 0; k < 3; k++) {
            force[k] += g[k];
            moment[k] += x[(k + 1) % 3] * g[(k + 2) % 3] - x[(k + 2) % 3] * g[(k + 1) % 3];
        }
    }
    free(f);
}

static void loads_have_the_right_resultants(void **state) {
    dgfem_shell_desc desc = shell_desc();
    dgfem_shell *shell = shell_make(&desc, 4, 3, 0, map_curved);
    int edges[256], starts[257], id, nodes[2] = {3, 7};
    double force[3], moment[3];
    (void)state;
    dgfem_shell_boundary(shell, edges, starts);
    for (int k = 0; k < 5; k++) {
        dgfem_vec3 expect = at3(0, 0, 0);
        double length = 0;
        if (k == 0) {
            shell->desc.gravity = shell->gravity_before = at3(0, 0, -2);
            expect = at3(0, 0, -2 * (double)dgfem_shell_mass(shell));
        } else if (k == 1) {
            check_status(dgfem_shell_add_force(shell, nodes, 2, at3(1, 2, 3), &id), DGFEM_OK);
            expect = at3(2, 4, 6);
        } else if (k == 2) { /* a moment is a couple: no resultant */
            check_status(dgfem_shell_set_moment(shell, edges, 5, 3, 1, &id), DGFEM_OK);
        } else if (k == 3) { /* the length of a curved side, by a hundred chords */
            check_status(dgfem_shell_set_line_load(shell, edges, 1, at3(1, -2, 4), &id), DGFEM_OK);
            const int *node = shell->edges[edges[0]].node;
            dgfem_vec3 a = shell->rest[node[0]], b = shell->rest[node[1]], m = shell->rest[node[2]], last = a;
            for (int i = 1; i <= 100; i++) {
                double s = i / 100.0, n0 = (1 - s) * (1 - 2 * s), n1 = s * (2 * s - 1), n2 = 4 * s * (1 - s);
                dgfem_vec3 x = at3(n0 * (double)a.x + n1 * (double)b.x + n2 * (double)m.x,
                                   n0 * (double)a.y + n1 * (double)b.y + n2 * (double)m.y,
                                   n0 * (double)a.z + n1 * (double)b.z + n2 * (double)m.z);
                length += check_distance(x, last), last = x;
            }
            expect = at3(length, -2 * length, 4 * length);
        } else { /* a spring pulls by what it is stretched */
            check_status(dgfem_shell_pin(shell, 5, 100, &id), DGFEM_OK);
            check_status(
                dgfem_shell_drag(
                    shell, id, at3((double)shell->rest[5].x + 0.5, (double)shell->rest[5].y, (double)shell->rest[5].z)),
                DGFEM_OK);
            expect = at3(50, 0, 0);
        }
        resultants(shell, force, moment);
        check_near3(at3(force[0], force[1], force[2]), expect, k == 3 ? 1e-4 : 2e3 * CHECK_EPSILON);
        if (k == 0) shell->desc.gravity = shell->gravity_before = at3(0, 0, 0);
        else check_status(dgfem_shell_remove_condition(shell, id), DGFEM_OK);
    }
    dgfem_shell_destroy(shell);
    /* A moment of 3 N on the side x = 1 of the unit square, tilting its normal outward, turns about y. */
    shell = shell_make(&desc, 3, 2, 1, map_flat);
    int count = shell_edges(shell, plane_of(1, 0, 0, 1), edges);
    check_status(dgfem_shell_set_moment(shell, edges, count, 3, 0, NULL), DGFEM_OK);
    resultants(shell, force, moment);
    check_near3(at3(force[0], force[1], force[2]), at3(0, 0, 0), 2e3 * CHECK_EPSILON);
    check_near3(at3(moment[0], moment[1], moment[2]), at3(0, 3, 0), 2e3 * CHECK_EPSILON);
    dgfem_shell_destroy(shell);
}

/* A pressure that follows a closed shell, deformed anyhow, does not push it, nor turn it by more than the three points
   of each triangle err: 0.3 % of p A r. */
static void pressure_in_a_closed_shell_is_balanced(void **state) {
    static const double points[] = {1, 0, 0, 0, 1, 0, 0, 0, 1, -1, 0, 0, 0, -1, 0, 0, 0, -1};
    static const int faces[] = {0, 1, 2, 1, 3, 2, 3, 4, 2, 4, 0, 2, 1, 0, 5, 3, 1, 5, 4, 3, 5, 0, 4, 5};
    check_random random = check_random_seeded(65);
    dgfem_shell_desc desc = shell_desc();
    dgfem_shell *shell;
    double force[3], moment[3];
    int calls = 0;
    (void)state;
    desc.vertices = dgfem_points_in_double(points, 6);
    desc.triangles = faces, desc.triangle_count = 8;
    desc.surface = on_sphere, desc.surface_user = &calls;
    check_status(dgfem_shell_create(&desc, &shell), DGFEM_OK);
    check_status(dgfem_shell_set_pressure(shell, NULL, 0, 7, 1, NULL), DGFEM_OK);
    for (int i = 0; i < shell->node_count; i++) {
        dgfem_vec3 x = shell->rest[i], u = check_random_vec3(&random, -0.1, 0.1);
        shell->position[i] = at3(1.2 * (double)x.x + (double)u.x, (double)(x.y + u.y), (double)(x.z + u.z));
    }
    resultants(shell, force, moment);
    check_near3(at3(force[0], force[1], force[2]), at3(0, 0, 0), 200 * CHECK_EPSILON);
    check_near3(at3(moment[0], moment[1], moment[2]), at3(0, 0, 0), 0.003 * 7 * 12);
    dgfem_shell_destroy(shell);
}

static void refuses_bad_conditions(void **state) {
    dgfem_shell_desc desc = shell_desc();
    check_host host;
    desc.hooks = check_hooks(&host);
    dgfem_shell *shell = shell_make(&desc, 2, 2, 0, map_flat);
    dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
    int bad = 1000, edges[256], inner = 0, id;
    (void)state;
    while (shell->edges[inner].element[1] == DGFEM_NONE) inner++;
    check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_ERROR_UNCONSTRAINED);
    check_logged(&host, "no node is held");
    check_status(dgfem_shell_fix_nodes(shell, &bad, 1, DGFEM_SHELL_X, at3(0, 0, 0), NULL), DGFEM_ERROR_INDEX);
    check_logged(&host, "node 1000");
    check_status(dgfem_shell_fix_nodes(shell, &inner, 1, 0, at3(0, 0, 0), NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "axes 0");
    check_status(dgfem_shell_clamp(shell, &inner, 1, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "not on the boundary");
    int count = shell_edges(shell, plane_of(1, 0, 0, 0), edges);
    check_status(dgfem_shell_clamp(shell, edges, count, &id), DGFEM_OK);
    check_status(dgfem_shell_fix_rotation(shell, edges, 1, 0, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "held by condition");
    check_status(dgfem_shell_set_moment(shell, edges, 1, (dgfem_real)NAN, 0, NULL), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "moment");
    check_status(dgfem_shell_remove_condition(shell, 77), DGFEM_ERROR_INDEX);
    check_logged(&host, "id 77");
    check_status(dgfem_shell_drag(shell, id, at3(0, 0, 0)), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "another kind");
    dgfem_mat3 no_rotation;
    memset(&no_rotation, 0, sizeof no_rotation);
    check_status(dgfem_shell_move_clamp(shell, id, no_rotation, at3(0, 0, 0)), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "not a rotation");
    no_rotation.m[0][0] = no_rotation.m[1][1] = 1, no_rotation.m[2][2] = -1;
    check_status(dgfem_shell_move_clamp(shell, id, no_rotation, at3(0, 0, 0)), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "a reflection");
    how.max_iterations = 0;
    check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "iterations");
    check_status(dgfem_shell_step(shell, 0, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "dt");
    how.cookie = 0;
    check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_ERROR_DESCRIPTOR);
    dgfem_shell_destroy(shell);
    assert_int_equal(host.live, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(counts_and_boundary),
        cmocka_unit_test(middles_on_a_surface),
        cmocka_unit_test(refuses_bad_meshes),
        cmocka_unit_test(survives_every_failing_allocation),
        cmocka_unit_test(six_zero_modes),
        cmocka_unit_test(stiffness_ignores_orientation),
        cmocka_unit_test(strains_are_derivatives_of_the_exact_ones),
        cmocka_unit_test(constant_membrane_strain_on_any_mesh),
        cmocka_unit_test(constant_curvature),
        cmocka_unit_test(rigid_motion_gives_no_force),
        cmocka_unit_test(tangent_is_the_derivative_of_the_force),
        cmocka_unit_test(matrix_is_the_symmetric_tangent),
        cmocka_unit_test(strip_bends_as_a_beam),
        cmocka_unit_test(strip_under_large_end_shear),
        cmocka_unit_test(strip_bends_far_from_the_origin),
        cmocka_unit_test(linear_shells_have_dead_loads),
        cmocka_unit_test(strip_rolls_up),
        cmocka_unit_test(fixed_point_agrees_with_newton),
        cmocka_unit_test(column_loses_stability_at_eulers_load),
        cmocka_unit_test(pressure_stretches_a_tube),
        cmocka_unit_test(moving_clamp_carries_the_shell),
        cmocka_unit_test(load_steps_turn_a_clamp),
        cmocka_unit_test(clamps_roll_a_strip),
        cmocka_unit_test(load_steps_drag_a_pin),
        cmocka_unit_test(stepped_cantilever_under_a_force),
        cmocka_unit_test(stepped_cantilever_under_moment_and_tension),
        cmocka_unit_test(refuses_given_middles_that_do_not_fit),
        cmocka_unit_test(loads_have_the_right_resultants),
        cmocka_unit_test(pressure_in_a_closed_shell_is_balanced),
        cmocka_unit_test(refuses_bad_conditions),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
