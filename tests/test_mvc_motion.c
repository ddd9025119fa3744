/* Bodies of polyhedra: rotations, motion, loads, contact, convergence, refusals. */
#define DGFEM_IMPLEMENTATION
#include "dgfem_mvc.h"
#include "check_mvc.h"
#include "check_threads.h"

static const double pi = 3.14159265358979323846;

static void set_positions(dgfem_mvc *body, const dgfem_vec3 *x) {
    check_status(dgfem_mvc_set_positions(body, dgfem_points_in_vec3(x, body->node_count)), DGFEM_OK);
}

static dgfem_vec3 *node_vectors(const dgfem_mvc *body) {
    dgfem_vec3 *x = (dgfem_vec3 *)calloc((size_t)body->node_count, sizeof *x);
    assert_non_null(x);
    return x;
}

static dgfem_vec3 turned(const dgfem_mat3 *r, dgfem_vec3 x) {
    mvc_affine a;
    a.linear = *r, a.offset = vec3(0, 0, 0);
    return mvc_affine_at(&a, x);
}

static dgfem_vec3 sum3(dgfem_vec3 a, dgfem_vec3 b) {
    return vec3((double)(a.x + b.x), (double)(a.y + b.y), (double)(a.z + b.z));
}

static dgfem_plane plane_at(double x, double y, double z, double offset) { return convex_mesh_plane(x, y, z, offset); }

static int *nodes_on(const dgfem_mvc *body, dgfem_plane plane, int *count) {
    int *nodes = (int *)malloc((size_t)body->node_count * sizeof(int));
    assert_non_null(nodes);
    *count = dgfem_mvc_nodes_on_plane(body, plane, (dgfem_real)1e-4, nodes, body->node_count);
    assert_in_range(*count, 1, body->node_count);
    return nodes;
}

static int *faces_on(const dgfem_mvc *body, dgfem_plane plane, int *count) {
    int *faces = (int *)malloc((size_t)body->face_count * sizeof(int));
    assert_non_null(faces);
    *count = dgfem_mvc_faces_on_plane(body, plane, (dgfem_real)1e-4, faces, body->face_count);
    assert_in_range(*count, 1, body->face_count);
    return faces;
}

static int fix_plane(dgfem_mvc *body, dgfem_plane plane, int axes) {
    int count, id, *nodes = nodes_on(body, plane, &count);
    check_status(dgfem_mvc_fix_nodes(body, nodes, count, axes, vec3(0, 0, 0), &id), DGFEM_OK);
    free(nodes);
    return id;
}

/* ---- rotations ---- */

/* Rigid motion: no force, no energy, no stress, the rotation found. */
static void test_rigid_motion(void **state) {
    (void)state;
    for (int m = 0; m < 2 * MVC_KINDS; m++) {
        dgfem_mvc_desc desc = mvc_desc();
        desc.quadrature = (dgfem_mvc_quadrature)(m % 3);
        desc.b_bar = m % 2;
        dgfem_mvc *body = mvc_of(&desc, mvc_mesh((mvc_kind)(m % MVC_KINDS), 3, 3));
        dgfem_vec3 *x = node_vectors(body), *force = node_vectors(body);
        for (int k = 0; k < 4; k++) {
            dgfem_mat3 r = mvc_rotation(1 + k, 2, -1, k == 3 ? pi : 0.5 + k);
            dgfem_energy energy;
            double worst = 0;
            for (int i = 0; i < body->node_count; i++) x[i] = sum3(turned(&r, body->rest[i]), vec3(1, -2, 0.5));
            set_positions(body, x);
            check_status(dgfem_mvc_internal_force(body, force), DGFEM_OK);
            for (int i = 0; i < body->node_count; i++) worst = fmax(worst, check_distance(force[i], vec3(0, 0, 0)));
            check_near(worst, 0, DGFEM_REAL_IS_FLOAT ? 2e-5 : 1e-12); /* in float, 1e-7 of coordinates about 3 */
            check_status(dgfem_mvc_energy(body, &energy), DGFEM_OK);
            check_near(energy.elastic, 0, DGFEM_REAL_IS_FLOAT ? 1e-9 : 1e-24);
            for (int e = 0; e < body->element_count; e++) {
                dgfem_mat3 stress;
                check_status(dgfem_mvc_stress(body, e, &stress), DGFEM_OK);
                for (int i = 0; i < 9; i++) check_near(stress.m[i / 3][i % 3], 0, DGFEM_REAL_IS_FLOAT ? 1e-2 : 1e-11);
                for (int i = 0; i < 9; i++)
                    check_near(body->rotation[e].m[i / 3][i % 3], r.m[i / 3][i % 3], 1e4 * CHECK_EPSILON);
            }
        }
        free(x), free(force);
        dgfem_mvc_destroy(body);
    }
}

/* Horn's rotation is the polar one of S^T, inverted elements included; where it is not determined the last one stays.
   */
static void test_horn(void **state) {
    (void)state;
    check_random random = check_random_seeded(11);
    dgfem_mvc_desc desc = mvc_desc();
    dgfem_mvc *body = mvc_of(&desc, mvc_mesh(MVC_HEX, 2, 3));
    dgfem_vec3 *x = node_vectors(body);
    for (int k = 0; k < 50; k++) {
        mvc_affine field = mvc_random_affine(&random, 1);
        for (int i = 0; i < body->node_count; i++) x[i] = mvc_affine_at(&field, body->rest[i]);
        set_positions(body, x);
        for (int e = 0; e < body->element_count; e++) {
            const dgfem_mvc_system *system = body->system;
            dgfem_mat3 s, identity, polar;
            dgfem_vec3 centre = mvc_affine_at(&field, body->centre[e]);
            memset(&s, 0, sizeof s);
            memset(&identity, 0, sizeof identity);
            for (int i = system->node_start[e]; i < system->node_start[e + 1]; i++) {
                int node = system->nodes[i];
                double a[3], b[3];
                a[0] = (double)(x[node].x - centre.x), a[1] = (double)(x[node].y - centre.y);
                a[2] = (double)(x[node].z - centre.z);
                b[0] = (double)(body->rest[node].x - body->centre[e].x);
                b[1] = (double)(body->rest[node].y - body->centre[e].y);
                b[2] = (double)(body->rest[node].z - body->centre[e].z);
                for (int j = 0; j < 9; j++)
                    s.m[j / 3][j % 3] += (dgfem_real)(30 * (double)system->share[i] * a[j / 3] * b[j % 3]);
            }
            polar = dgfem_rotation_of(s, identity);
            for (int i = 0; i < 9; i++)
                check_near(body->rotation[e].m[i / 3][i % 3], polar.m[i / 3][i % 3],
                           DGFEM_REAL_IS_FLOAT ? 1e-2 : 1e-8); /* both as well as the gap of eigenvalues lets them */
        }
    }
    dgfem_mat3 before = body->rotation[0];
    for (int k = 0; k < 2; k++) { /* a point, a line */
        for (int i = 0; i < body->node_count; i++) {
            dgfem_vec3 p = body->rest[i];
            x[i] = k ? vec3((double)(p.x + p.y), 0, 0) : vec3(1, 2, 3);
        }
        set_positions(body, x);
        for (int i = 0; i < 9; i++) check_near(body->rotation[0].m[i / 3][i % 3], before.m[i / 3][i % 3], 0);
    }
    free(x);
    dgfem_mvc_destroy(body);
    body = mvc_of(&desc, mvc_octahedron()); /* its inertia is the same about all axes */
    x = node_vectors(body);
    dgfem_mat3 r = mvc_rotation(1, 1, 0, 0.4);
    for (int i = 0; i < 6; i++) x[i] = turned(&r, body->rest[i]);
    set_positions(body, x);
    before = body->rotation[0];
    for (int i = 0; i < 9; i++) check_near(before.m[i / 3][i % 3], r.m[i / 3][i % 3], 20 * CHECK_EPSILON);
    for (int i = 0; i < 6; i++) /* a point reflection */
        x[i] = vec3(-(double)body->rest[i].x, -(double)body->rest[i].y, -(double)body->rest[i].z);
    set_positions(body, x);
    for (int i = 0; i < 9; i++) check_near(body->rotation[0].m[i / 3][i % 3], before.m[i / 3][i % 3], 0);
    free(x);
    dgfem_mvc_destroy(body);
}

/* ---- forces ---- */

/* Without warping f = K u, and twice the energy is u . K u, from the elements' dense matrices. */
static void test_linear_forces(void **state) {
    (void)state;
    check_random random = check_random_seeded(12);
    dgfem_mvc_desc desc = mvc_desc();
    desc.warp = 0;
    dgfem_mvc *body = mvc_of(&desc, mvc_mesh(MVC_PLANES, 2, 3));
    dgfem_vec3 *x = node_vectors(body), *force = node_vectors(body);
    double *expected = (double *)calloc(3 * (size_t)body->node_count, sizeof(double)), work = 0;
    for (int i = 0; i < body->node_count; i++) x[i] = sum3(body->rest[i], check_random_vec3(&random, -0.1, 0.1));
    set_positions(body, x);
    for (int e = 0; e < body->element_count; e++) {
        int nodes[64], n = dgfem_mvc_element_nodes(body, e, nodes, 64);
        dgfem_real *k = (dgfem_real *)malloc(9 * (size_t)n * (size_t)n * sizeof *k);
        assert_non_null(k);
        check_status(dgfem_mvc_element_stiffness(body, e, k), DGFEM_OK);
        for (int row = 0; row < 3 * n; row++)
            for (int column = 0; column < 3 * n; column++) {
                dgfem_vec3 a = x[nodes[column / 3]], b = body->rest[nodes[column / 3]];
                double u[3];
                u[0] = (double)a.x - (double)b.x, u[1] = (double)a.y - (double)b.y, u[2] = (double)a.z - (double)b.z;
                assert_true(k[row * 3 * n + column] == k[column * 3 * n + row]);
                expected[3 * nodes[row / 3] + row % 3] += (double)k[row * 3 * n + column] * u[column % 3];
            }
        free(k);
    }
    check_status(dgfem_mvc_internal_force(body, force), DGFEM_OK);
    for (int i = 0; i < body->node_count; i++) {
        check_near3(force[i], vec3(expected[3 * i], expected[3 * i + 1], expected[3 * i + 2]), 1e3 * CHECK_EPSILON);
        work += expected[3 * i] * (double)(x[i].x - body->rest[i].x);
        work += expected[3 * i + 1] * (double)(x[i].y - body->rest[i].y);
        work += expected[3 * i + 2] * (double)(x[i].z - body->rest[i].z);
    }
    dgfem_energy energy;
    check_status(dgfem_mvc_energy(body, &energy), DGFEM_OK);
    check_near(energy.elastic, work / 2, 1e3 * CHECK_EPSILON);
    free(expected), free(x), free(force);
    dgfem_mvc_destroy(body);
}

/* Warped forces sum to zero. */
static void test_forces_balance(void **state) {
    (void)state;
    check_random random = check_random_seeded(13);
    dgfem_mvc_desc desc = mvc_desc();
    dgfem_mvc *body = mvc_of(&desc, mvc_mesh(MVC_VORONOI, 2, 3));
    dgfem_vec3 *x = node_vectors(body), *force = node_vectors(body), sum = vec3(0, 0, 0);
    for (int i = 0; i < body->node_count; i++) x[i] = sum3(body->rest[i], check_random_vec3(&random, -0.2, 0.2));
    set_positions(body, x);
    check_status(dgfem_mvc_internal_force(body, force), DGFEM_OK);
    for (int i = 0; i < body->node_count; i++) sum = sum3(sum, force[i]);
    check_near3(sum, vec3(0, 0, 0), 1e3 * CHECK_EPSILON);
    free(x), free(force);
    dgfem_mvc_destroy(body);
}

/* A bar under traction: the uniaxial state, its stress, on every kind of mesh. */
static void test_tension(void **state) {
    (void)state;
    for (int m = 0; m < 8; m++) {
        dgfem_mvc_desc desc = mvc_desc();
        desc.quadrature = m & 1 ? DGFEM_MVC_PAPER : DGFEM_MVC_TET4;
        desc.solver = m & 2 ? DGFEM_SOLVER_PCG : DGFEM_SOLVER_CHOLESKY;
        desc.solver_tolerance = DGFEM_REAL_IS_FLOAT ? (dgfem_real)1e-5 : (dgfem_real)1e-13;
        desc.warp = 0;
        dgfem_mvc *body = mvc_of(&desc, mvc_mesh(m & 4 ? MVC_PLANES : MVC_HEX, 2, 9));
        double tolerance = DGFEM_REAL_IS_FLOAT ? 1e-3 : 1e-11;
        int count, *faces = faces_on(body, plane_at(1, 0, 0, 1), &count);
        (void)fix_plane(body, plane_at(1, 0, 0, 0), DGFEM_MVC_X);
        (void)fix_plane(body, plane_at(0, 1, 0, 0), DGFEM_MVC_Y);
        (void)fix_plane(body, plane_at(0, 0, 1, 0), DGFEM_MVC_Z);
        check_status(dgfem_mvc_set_traction(body, faces, count, vec3(0.1, 0, 0), NULL), DGFEM_OK);
        check_status(dgfem_mvc_solve_static(body, NULL, NULL), DGFEM_OK);
        for (int i = 0; i < body->node_count; i++) {
            dgfem_vec3 p = body->rest[i];
            check_near3(body->position[i], vec3(1.1 * (double)p.x, 0.97 * (double)p.y, 0.97 * (double)p.z), tolerance);
        }
        for (int e = 0; e < body->element_count; e++) {
            dgfem_mat3 stress;
            check_status(dgfem_mvc_stress(body, e, &stress), DGFEM_OK);
            for (int i = 0; i < 9; i++) check_near(stress.m[i / 3][i % 3], i ? 0 : 0.1, 100 * tolerance);
        }
        free(faces);
        dgfem_mvc_destroy(body);
    }
}

/* Pressure all around: forces sum to zero, and to pressure times area on one side; uniform compression. */
static void test_pressure(void **state) {
    (void)state;
    dgfem_mvc_desc desc = mvc_desc();
    dgfem_mvc *body = mvc_of(&desc, mvc_mesh(MVC_PLANES, 2, 9));
    dgfem_vec3 *force = node_vectors(body), sum = vec3(0, 0, 0);
    int count, id, *faces = faces_on(body, plane_at(0, 1, 0, 1), &count);
    check_status(dgfem_mvc_set_pressure(body, faces, count, (dgfem_real)0.25, &id), DGFEM_OK);
    check_status(dgfem_mvc_external_force(body, force), DGFEM_OK);
    for (int i = 0; i < body->node_count; i++) sum = sum3(sum, force[i]);
    check_near3(sum, vec3(0, -0.25, 0), 50 * CHECK_EPSILON);
    check_status(dgfem_mvc_change_load(body, id, vec3(0, 0, 0), (dgfem_real)0.5), DGFEM_OK);
    check_status(dgfem_mvc_external_force(body, force), DGFEM_OK);
    sum = vec3(0, 0, 0);
    for (int i = 0; i < body->node_count; i++) sum = sum3(sum, force[i]);
    check_near3(sum, vec3(0, -0.5, 0), 50 * CHECK_EPSILON);
    check_status(dgfem_mvc_remove_condition(body, id), DGFEM_OK);
    check_status(dgfem_mvc_external_force(body, force), DGFEM_OK);
    for (int i = 0; i < body->node_count; i++) check_near3(force[i], vec3(0, 0, 0), 0);
    free(force), free(faces);
    dgfem_mvc_destroy(body);
}

/* ---- motion ---- */

/* Free fall of implicit Euler: after n steps of h, n (n + 1) / 2 g h^2; momentum and energy follow. */
static void test_free_fall(void **state) {
    (void)state;
    dgfem_mvc_desc desc = mvc_desc();
    desc.gravity = vec3(0, 0, -10);
    dgfem_mvc *body = mvc_of(&desc, mvc_mesh(MVC_VORONOI, 2, 9));
    for (int n = 0; n < 10; n++) check_status(dgfem_mvc_step(body, (dgfem_real)0.01, NULL), DGFEM_OK);
    dgfem_vec3 linear, angular;
    dgfem_energy energy;
    for (int i = 0; i < body->node_count; i++)
        check_near3(body->position[i], sum3(body->rest[i], vec3(0, 0, -0.055)), 2e3 * CHECK_EPSILON);
    check_status(dgfem_mvc_momentum(body, &linear, &angular), DGFEM_OK);
    check_near3(linear, vec3(0, 0, -1), 1e3 * CHECK_EPSILON);
    check_near3(angular, vec3(-0.5, 0.5, 0), 1e3 * CHECK_EPSILON);
    check_status(dgfem_mvc_energy(body, &energy), DGFEM_OK);
    check_near(energy.kinetic, 0.5, 1e3 * CHECK_EPSILON);
    check_near(energy.gravity, 10 * (0.5 - 0.055), 1e3 * CHECK_EPSILON);
    check_near(body->time, 0.1, 1e-7);
    dgfem_mvc_destroy(body);
}

/* a x = b by Gauss's method with pivots; both are destroyed, x is left in b. */
static void solve_dense(double *a, double *b, int n) {
    for (int k = 0; k < n; k++) {
        int best = k;
        for (int i = k; i < n; i++)
            if (fabs(a[i * n + k]) > fabs(a[best * n + k])) best = i;
        for (int j = 0; j < n; j++) {
            double t = a[k * n + j];
            a[k * n + j] = a[best * n + j], a[best * n + j] = t;
        }
        double t = b[k];
        b[k] = b[best], b[best] = t;
        for (int i = k + 1; i < n; i++) {
            double s = a[i * n + k] / a[k * n + k];
            for (int j = k; j < n; j++) a[i * n + j] -= s * a[k * n + j];
            b[i] -= s * b[k];
        }
    }
    for (int k = n - 1; k >= 0; k--) {
        for (int j = k + 1; j < n; j++) b[k] -= a[k * n + j] * b[j];
        b[k] /= a[k * n + k];
    }
}

/* Without warping, a step is (M + h (alpha M + beta K) + h^2 K) v+ = M v - h K u + h M g: against dense matrices. */
static void test_step_is_implicit_euler(void **state) {
    (void)state;
    enum { N = 24 };
    check_random random = check_random_seeded(14);
    dgfem_mvc_desc desc = mvc_desc();
    dgfem_vec3 x[8], w[8];
    dgfem_real k[N * N];
    int nodes[8];
    double h = 0.1, u[N], v[N];
    desc.warp = 0;
    desc.damping_mass = (dgfem_real)0.3, desc.damping_stiffness = (dgfem_real)0.05;
    desc.gravity = vec3(1, 2, 3);
    dgfem_mvc *body = mvc_of(&desc, mvc_grid(1, 1, 1, 1, 1, 1));
    check_status(dgfem_mvc_element_stiffness(body, 0, k), DGFEM_OK);
    assert_int_equal(dgfem_mvc_element_nodes(body, 0, nodes, 8), 8);
    for (int i = 0; i < 8; i++) {
        dgfem_vec3 d = check_random_vec3(&random, -0.1, 0.1);
        w[i] = check_random_vec3(&random, -1, 1), x[i] = sum3(body->rest[i], d);
    }
    set_positions(body, x);
    check_status(dgfem_mvc_set_velocities(body, dgfem_points_in_vec3(w, 8)), DGFEM_OK);
    for (int i = 0; i < N; i++) {
        dgfem_vec3 p = x[nodes[i / 3]], r = body->rest[nodes[i / 3]], q = w[nodes[i / 3]];
        u[i] = (double)(i % 3 == 0 ? p.x - r.x : i % 3 == 1 ? p.y - r.y : p.z - r.z);
        v[i] = (double)(i % 3 == 0 ? q.x : i % 3 == 1 ? q.y : q.z);
    }
    for (int n = 0; n < 10; n++) {
        double a[N * N], b[N];
        for (int i = 0; i < N; i++) {
            double mass = (double)body->mass[nodes[i / 3]];
            b[i] = mass * (v[i] + h * (1 + i % 3));
            for (int j = 0; j < N; j++) {
                a[i * N + j] = (h * h + 0.05 * h) * (double)k[i * N + j] + (i == j ? (1 + 0.3 * h) * mass : 0);
                b[i] -= h * (double)k[i * N + j] * u[j];
            }
        }
        solve_dense(a, b, N);
        for (int i = 0; i < N; i++) v[i] = b[i], u[i] += h * b[i];
        check_status(dgfem_mvc_step(body, (dgfem_real)h, NULL), DGFEM_OK);
        for (int i = 0; i < 8; i++) {
            dgfem_vec3 r = body->rest[nodes[i]];
            check_near3(body->position[nodes[i]], sum3(r, vec3(u[3 * i], u[3 * i + 1], u[3 * i + 2])),
                        1e4 * CHECK_EPSILON);
            check_near3(body->velocity[nodes[i]], vec3(v[3 * i], v[3 * i + 1], v[3 * i + 2]), 1e5 * CHECK_EPSILON);
        }
    }
    dgfem_mvc_destroy(body);
}

typedef struct twist {
    double angle;
} twist;

static void twist_fn(void *user, dgfem_vec3 rest, dgfem_vec3 *displacement) {
    double angle = ((const twist *)user)->angle, c = cos(angle) - 1, s = sin(angle);
    double y = (double)rest.y - 0.5, z = (double)rest.z - 0.5;
    *displacement = vec3(0, c * y - s * z, s * y + c * z);
}

/* One end is turned through 90 degrees by moving nodes, twice alike: by matrix and by function. The body follows
   without blowing up, and comes to rest with the volume nearly kept. */
static void test_twist(void **state) {
    (void)state;
    dgfem_mvc *bodies[2];
    for (int k = 0; k < 2; k++) {
        dgfem_mvc_desc desc = mvc_desc();
        desc.damping_mass = 5;
        bodies[k] = mvc_of(&desc, mvc_grid(4, 2, 2, 3, 1, 1));
        (void)fix_plane(bodies[k], plane_at(1, 0, 0, 0), DGFEM_MVC_XYZ);
    }
    int id = fix_plane(bodies[0], plane_at(1, 0, 0, 3), DGFEM_MVC_XYZ), count;
    int *nodes = nodes_on(bodies[1], plane_at(1, 0, 0, 3), &count);
    twist t;
    t.angle = 0;
    check_status(dgfem_mvc_fix_nodes_fn(bodies[1], nodes, count, DGFEM_MVC_XYZ, twist_fn, &t, NULL), DGFEM_OK);
    for (int step = 1; step <= 200; step++) {
        t.angle = fmin(pi / 2, step * pi / 200);
        dgfem_mat3 linear = mvc_rotation(1, 0, 0, t.angle);
        dgfem_vec3 middle = vec3(0, 0.5, 0.5), moved = turned(&linear, middle);
        for (int i = 0; i < 3; i++) linear.m[i][i] -= 1;
        check_status(
            dgfem_mvc_move_fixture(bodies[0], id, linear, vec3(0, 0.5 - (double)moved.y, 0.5 - (double)moved.z)),
            DGFEM_OK);
        for (int k = 0; k < 2; k++) check_status(dgfem_mvc_step(bodies[k], (dgfem_real)0.1, NULL), DGFEM_OK);
    }
    for (int i = 0; i < bodies[0]->node_count; i++)
        check_near3(bodies[0]->position[i], bodies[1]->position[i], DGFEM_REAL_IS_FLOAT ? 1e-3 : 1e-11);
    for (int i = 0; i < count; i++) {
        dgfem_vec3 u;
        twist_fn(&t, bodies[1]->rest[nodes[i]], &u);
        check_near3(bodies[1]->position[nodes[i]], sum3(bodies[1]->rest[nodes[i]], u), 20 * CHECK_EPSILON);
    }
    for (int i = 0; i < bodies[1]->node_count; i++) { /* twisted evenly: a quarter turn over the length */
        twist part;
        dgfem_vec3 u;
        part.angle = pi / 2 * (double)bodies[1]->rest[i].x / 3;
        twist_fn(&part, bodies[1]->rest[i], &u);
        check_near(check_distance(bodies[1]->position[i], sum3(bodies[1]->rest[i], u)), 0, 0.12);
    }
    check_near(dgfem_mvc_volume(bodies[0]), 3, 0.3);
    free(nodes);
    dgfem_mvc_destroy(bodies[0]), dgfem_mvc_destroy(bodies[1]);
}

/* A pinned node follows its place; forces on nodes pull. */
static void test_pins_and_forces(void **state) {
    (void)state;
    dgfem_mvc_desc desc = mvc_desc();
    desc.damping_mass = 5;
    desc.material.young = 100;
    dgfem_mvc *body = mvc_of(&desc, mvc_grid(1, 1, 1, 1, 1, 1));
    int pin, force, node = dgfem_mvc_nearest_node(body, vec3(1.1, 1.1, 1.1)), all[8];
    double sum = 0;
    check_near3(body->rest[node], vec3(1, 1, 1), 0);
    for (int i = 0; i < 8; i++) all[i] = i;
    check_status(dgfem_mvc_pin(body, node, 2, &pin), DGFEM_OK);
    check_status(dgfem_mvc_drag(body, pin, vec3(3, 2, 1)), DGFEM_OK);
    for (int n = 0; n < 400; n++) check_status(dgfem_mvc_step(body, (dgfem_real)0.1, NULL), DGFEM_OK);
    check_near3(body->position[node], vec3(3, 2, 1), 1e-3);
    check_status(dgfem_mvc_add_force(body, all, 8, vec3(0, 0, 0.25), &force), DGFEM_OK);
    for (int n = 0; n < 400; n++) check_status(dgfem_mvc_step(body, (dgfem_real)0.1, NULL), DGFEM_OK);
    check_near3(body->position[node], vec3(3, 2, 2), 1e-3); /* 8 * 0.25 N on 2 N/m */
    for (int i = 0; i < 8; i++) sum += (double)body->position[i].z;
    assert_true(sum > 8 * 2.0); /* the rest stands above it */
    dgfem_mvc_destroy(body);
}

/* ---- contact ---- */

static dgfem_mvc *block_on(double tilt, double friction, int kind, int *shape) {
    dgfem_mvc_desc desc = mvc_desc();
    dgfem_shape_desc plane = dgfem_default_shape_desc();
    desc.material.young = 10000;
    desc.material.density = 10;
    desc.gravity = vec3(10 * sin(tilt), 0, -10 * cos(tilt));
    plane.plane = plane_at(0, 0, 1, 0);
    plane.friction = (dgfem_real)friction;
    dgfem_mvc *body = mvc_of(&desc, mvc_mesh((mvc_kind)kind, 2, 3));
    check_status(dgfem_mvc_add_plane(body, &plane, shape), DGFEM_OK);
    return body;
}

static double mean_x(const dgfem_mvc *body, int axis) {
    double sum = 0;
    for (int i = 0; i < body->node_count; i++) {
        dgfem_vec3 p = body->position[i];
        sum += (double)body->mass[i] * (double)(axis ? p.z : p.x) / 10;
    }
    return sum;
}

/* A block rests on a plane: the plane carries its weight. Steeper than the angle of friction it slides as Coulomb says,
   less steep it stays. */
static void test_friction(void **state) {
    (void)state;
    for (int m = 0; m < 4; m++) {
        int shape, slides = m & 1;
        double tilt = atan(slides ? 0.6 : 0.3), h = 0.005, start, speed;
        dgfem_mvc *body = block_on(tilt, 0.4, m & 2 ? MVC_VORONOI : MVC_CUBE, &shape);
        dgfem_mvc_info info;
        for (int n = 0; n < 100; n++) check_status(dgfem_mvc_step(body, (dgfem_real)h, &info), DGFEM_OK);
        assert_true(info.contacts >= 4);
        start = mean_x(body, 0);
        dgfem_vec3 before, after;
        check_status(dgfem_mvc_momentum(body, &before, NULL), DGFEM_OK);
        for (int n = 0; n < 100; n++) check_status(dgfem_mvc_step(body, (dgfem_real)h, NULL), DGFEM_OK);
        check_status(dgfem_mvc_momentum(body, &after, NULL), DGFEM_OK);
        speed = (double)(after.x - before.x) / 10 / 0.5;
        if (slides) check_near(speed, 10 * (sin(tilt) - 0.4 * cos(tilt)), 0.06);
        else check_near(mean_x(body, 0) - start, 0, 1e-3);
        check_near(mean_x(body, 1), 0.5, 0.01);
        dgfem_mvc_destroy(body);
    }
}

/* Nothing sinks through: a ball's inside holds the body, a moving plane carries it. */
static void test_shapes(void **state) {
    (void)state;
    dgfem_mvc_desc desc = mvc_desc();
    dgfem_shape_desc ball = dgfem_default_shape_desc(), lift = dgfem_default_shape_desc();
    dgfem_mvc *body;
    int shape;
    desc.material.young = 1000;
    desc.gravity = vec3(0, 0, -10);
    ball.centre = vec3(0.5, 0.5, 1);
    ball.radius = -2;
    body = mvc_of(&desc, mvc_mesh(MVC_PLANES, 2, 3));
    check_status(dgfem_mvc_add_sphere(body, &ball, NULL), DGFEM_OK);
    for (int n = 0; n < 300; n++) check_status(dgfem_mvc_step(body, (dgfem_real)0.01, NULL), DGFEM_OK);
    for (int i = 0; i < body->node_count; i++) assert_true(check_distance(body->position[i], ball.centre) < 2.02);
    dgfem_mvc_destroy(body);
    body = mvc_of(&desc, mvc_mesh(MVC_HEX, 2, 3));
    lift.plane = plane_at(0, 0, 2, 0);
    lift.velocity = vec3(0, 0, 1);
    check_status(dgfem_mvc_add_plane(body, &lift, &shape), DGFEM_OK);
    for (int n = 0; n < 200; n++) {
        lift.plane.offset = (dgfem_real)(2 * 0.01 * (n + 1));
        check_status(dgfem_mvc_step(body, (dgfem_real)0.01, NULL), DGFEM_OK);
        check_status(dgfem_mvc_move_shape(body, shape, &lift), DGFEM_OK);
    }
    for (int i = 0; i < body->node_count; i++) {
        assert_true((double)body->position[i].z > 2 - 0.05);
        check_near(body->velocity[i].z, 1, 0.05);
    }
    dgfem_mvc_destroy(body);
}

/* ---- refusals ---- */

static dgfem_status run_create(void *context, const dgfem_hooks *hooks) {
    dgfem_mvc_desc desc = mvc_desc();
    dgfem_mvc *body = NULL;
    desc.mesh = (const dgfem_mesh *)context;
    desc.solver = desc.mesh->element_count == 1 ? DGFEM_SOLVER_PCG : DGFEM_SOLVER_CHOLESKY;
    desc.hooks = *hooks;
    dgfem_status status = dgfem_mvc_create(&desc, &body);
    assert_true((status == DGFEM_OK) == (body != NULL));
    dgfem_mvc_destroy(body);
    return status;
}

static void test_allocation_failures(void **state) {
    (void)state;
    dgfem_mesh *mesh = mvc_mesh(MVC_PLANES, 1, 3);
    long calls = check_every_allocation(run_create, mesh);
    print_message("%ld allocations\n", calls);
    dgfem_mesh_destroy(mesh);
    mesh = mvc_grid(1, 1, 1, 1, 1, 1);
    (void)check_every_allocation(run_create, mesh);
    dgfem_mesh_destroy(mesh);
}

static void check_body_allocations(dgfem_solver solver, check_workers *workers) {
    check_host host;
    dgfem_mvc_desc desc = mvc_desc();
    desc.hooks = check_hooks(&host);
    desc.solver = solver;
    if (workers) desc.hooks.parallel_for = check_parallel_for, desc.hooks.parallel_for_user = workers;
    dgfem_shape_desc shape = dgfem_default_shape_desc();
    shape.plane = plane_at(0, 0, 1, -5);
    dgfem_mvc *body = mvc_of(&desc, mvc_mesh(MVC_HEX, 2, 3));
    int count, *nodes = nodes_on(body, plane_at(1, 0, 0, 0), &count), face;
    (void)dgfem_mvc_faces_on_plane(body, plane_at(1, 0, 0, 1), (dgfem_real)1e-4, &face, 1);
    for (int call = 0; call < 6; call++)
        for (long fail = 1;; fail++) {
            int conditions = body->condition_count, shapes = body->shape_count;
            dgfem_vec3 first = body->position[7];
            host.calls = 0, host.fail_from = fail, host.log_count = 0;
            dgfem_status status = call == 0
                                      ? dgfem_mvc_fix_nodes(body, nodes, count, DGFEM_MVC_XYZ, vec3(0, 0, 0), NULL)
                                  : call == 1 ? dgfem_mvc_pin(body, 0, 1, NULL)
                                  : call == 2 ? dgfem_mvc_add_force(body, nodes, 1, vec3(0, 0, 0.001), NULL)
                                  : call == 3 ? dgfem_mvc_set_traction(body, &face, 1, vec3(0.01, 0, 0), NULL)
                                  : call == 4 ? dgfem_mvc_add_plane(body, &shape, NULL)
                                              : dgfem_mvc_solve_static(body, NULL, NULL);
            host.fail_from = 0;
            if (!status) break;
            check_status(status, DGFEM_ERROR_MEMORY);
            check_logged(&host, "out of memory");
            assert_int_equal(body->condition_count, conditions);
            assert_int_equal(body->shape_count, shapes);
            check_near3(body->position[7], first, 0);
        }
    host.calls = 0; /* a step takes no memory */
    for (int n = 0; n < 5; n++) check_status(dgfem_mvc_step(body, (dgfem_real)0.01, NULL), DGFEM_OK);
    assert_int_equal(host.calls, 0);
    /* the first one after cuts does, once for all of them: without it nothing moves */
    for (int cut = 0; cut < 2; cut++)
        check_status(dgfem_mvc_cut_plane(body, plane_at(0, cut, !cut, 0.45), NULL, NULL), DGFEM_OK);
    for (long fail = 1;; fail++) {
        dgfem_vec3 first = body->position[7];
        double time = body->time;
        host.calls = 0, host.fail_from = fail, host.log_count = 0;
        dgfem_status status = dgfem_mvc_step(body, (dgfem_real)0.01, NULL);
        host.fail_from = 0;
        if (!status) break;
        assert_in_range(fail, 1, 1000);
        check_status(status, DGFEM_ERROR_MEMORY);
        check_logged(&host, "out of memory");
        check_near3(body->position[7], first, 0);
        check_near(body->time, time, 0);
    }
    host.calls = 0;
    check_status(dgfem_mvc_step(body, (dgfem_real)0.01, NULL), DGFEM_OK);
    assert_int_equal(host.calls, 0);
    free(nodes);
    dgfem_mvc_destroy(body);
    assert_int_equal(host.live, 0);
}

/* Conditions, steps and static solves whose memory fails leave the body as it was. */
static void test_body_allocation_failures(void **state) {
    (void)state;
    check_workers workers = {1, 0};
    check_body_allocations(DGFEM_SOLVER_CHOLESKY, NULL);
    check_body_allocations(DGFEM_SOLVER_PCG, &workers);
    assert_true(workers.loops > 0);
}

/* Falling, cut, falling on, solved: the same bits for any number of threads. */
static void test_threads(void **state) {
    (void)state;
    enum { RUNS = 4 };
    static const int threads[RUNS] = {0, 1, 3, 7};
    dgfem_vec3 *expected = NULL;
    int expected_count = 0;
    for (int run = 0; run < RUNS; run++) {
        check_workers workers = {threads[run], 0};
        dgfem_mvc_desc desc = mvc_desc();
        dgfem_shape_desc ground = dgfem_default_shape_desc();
        ground.plane = plane_at(0, 0, 1, -0.01);
        if (threads[run]) desc.hooks.parallel_for = check_parallel_for, desc.hooks.parallel_for_user = &workers;
        dgfem_mvc *body = mvc_of(&desc, mvc_mesh(MVC_PLANES, 4, 3));
        check_status(dgfem_mvc_add_plane(body, &ground, NULL), DGFEM_OK);
        check_status(dgfem_mvc_set_gravity(body, vec3(3, 1, -9)), DGFEM_OK);
        for (int step = 0; step < 8; step++) {
            if (step == 4) check_status(dgfem_mvc_cut_plane(body, plane_at(0.6, 0, 0.8, 0.65), NULL, NULL), DGFEM_OK);
            check_status(dgfem_mvc_step(body, (dgfem_real)0.01, NULL), DGFEM_OK);
        }
        dgfem_vec3 *force = (dgfem_vec3 *)malloc((size_t)body->node_count * sizeof *force);
        assert_non_null(force);
        check_status(dgfem_mvc_internal_force(body, force), DGFEM_OK);
        if (!expected) {
            expected_count = body->node_count;
            expected = (dgfem_vec3 *)malloc(2 * (size_t)expected_count * sizeof *expected);
            assert_non_null(expected);
            memcpy(expected, body->position, (size_t)expected_count * sizeof *expected);
            memcpy(expected + expected_count, force, (size_t)expected_count * sizeof *expected);
        }
        assert_int_equal(body->node_count, expected_count);
        assert_memory_equal(body->position, expected, (size_t)expected_count * sizeof *expected);
        assert_memory_equal(force, expected + expected_count, (size_t)expected_count * sizeof *expected);
        if (threads[run]) assert_true(workers.loops >= 8 * 4);
        free(force);
        dgfem_mvc_destroy(body);
    }
    free(expected);
}

/* One wrong member at a time. */
static void test_bad_descriptors(void **state) {
    (void)state;
    check_host host;
    dgfem_mesh *mesh = mvc_grid(1, 1, 1, 1, 1, 1);
    dgfem_mvc *body = NULL;
    dgfem_mvc_desc good = mvc_desc(), desc;
    good.hooks = check_hooks(&host);
    good.mesh = mesh;
    check_status(dgfem_mvc_create(NULL, &body), DGFEM_ERROR_DESCRIPTOR);
    check_status(dgfem_mvc_create(&good, NULL), DGFEM_ERROR_ARGUMENT);
    memset(&desc, 0, sizeof desc);
    check_status(dgfem_mvc_create(&desc, &body), DGFEM_ERROR_DESCRIPTOR);
    desc = good, desc.mesh = NULL;
    check_status(dgfem_mvc_create(&desc, &body), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "no mesh");
    desc = good, desc.material.poisson = (dgfem_real)0.5;
    check_status(dgfem_mvc_create(&desc, &body), DGFEM_ERROR_MATERIAL);
    check_logged(&host, "element 0");
    desc = good, desc.material.young = (dgfem_real)NAN;
    check_status(dgfem_mvc_create(&desc, &body), DGFEM_ERROR_MATERIAL);
    check_logged(&host, "young nan");
    desc = good, desc.material.density = 0;
    check_status(dgfem_mvc_create(&desc, &body), DGFEM_ERROR_MATERIAL);
    check_logged(&host, "density 0");
    desc = good, desc.quadrature = (dgfem_mvc_quadrature)3;
    check_status(dgfem_mvc_create(&desc, &body), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "quadrature 3");
    for (int solver = 0; solver < 8; solver++) { /* those of a dgfem_body that are not there, and unknown ones */
        char text[32];
        if (solver == (int)DGFEM_SOLVER_CHOLESKY || solver == (int)DGFEM_SOLVER_PCG) continue;
        snprintf(text, sizeof text, "solver %d: ", solver);
        desc = good, desc.solver = (dgfem_solver)solver;
        check_status(dgfem_mvc_create(&desc, &body), DGFEM_ERROR_ARGUMENT);
        check_logged(&host, text);
    }
    desc = good, desc.stabilisation = -1;
    check_status(dgfem_mvc_create(&desc, &body), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "stabilisation -1");
    desc = good, desc.damping_mass = (dgfem_real)INFINITY;
    check_status(dgfem_mvc_create(&desc, &body), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "damping_mass inf");
    desc = good, desc.gravity.y = (dgfem_real)NAN;
    check_status(dgfem_mvc_create(&desc, &body), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "gravity");
    desc = good, desc.solver_iterations = 0;
    check_status(dgfem_mvc_create(&desc, &body), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "0 solver_iterations");
    assert_null(body);
    dgfem_mesh_destroy(mesh);
    assert_int_equal(host.live, 0);
}

static void test_bad_calls(void **state) {
    (void)state;
    check_host host;
    dgfem_mvc_desc desc = mvc_desc();
    desc.hooks = check_hooks(&host);
    dgfem_mvc *body = mvc_of(&desc, mvc_grid(2, 1, 1, 2, 1, 1));
    int items[2], id, inner = DGFEM_NONE, owners[2];
    dgfem_vec3 zero = vec3(0, 0, 0), bad = vec3(0, (double)NAN, 0);
    dgfem_mat3 matrix;
    dgfem_shape_desc shape = dgfem_default_shape_desc();
    dgfem_mvc_static_desc statics = dgfem_default_mvc_static_desc();
    memset(&matrix, 0, sizeof matrix);
    items[0] = 0, items[1] = 12;
    for (int f = 0; f < body->face_count; f++) {
        dgfem_mvc_face_elements(body, f, owners);
        if (owners[1] != DGFEM_NONE) inner = f;
    }
    assert_true(inner >= 0);
    check_status(dgfem_mvc_fix_nodes(NULL, items, 1, 7, zero, NULL), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_mvc_fix_nodes(body, items, 2, 7, zero, NULL), DGFEM_ERROR_INDEX);
    check_logged(&host, "node 12 of 12");
    check_status(dgfem_mvc_fix_nodes(body, items, 0, 7, zero, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "0 nodes");
    check_status(dgfem_mvc_fix_nodes(body, items, 1, 8, zero, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "axes 8");
    check_status(dgfem_mvc_fix_nodes(body, items, 1, 7, bad, NULL), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "displacement");
    check_status(dgfem_mvc_fix_nodes_fn(body, items, 1, 7, NULL, NULL, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "no function");
    check_status(dgfem_mvc_set_traction(body, &inner, 1, zero, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "not on the boundary");
    check_status(dgfem_mvc_set_pressure(body, items, 1, (dgfem_real)NAN, NULL), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "pressure nan");
    check_status(dgfem_mvc_pin(body, 0, -1, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "stiffness -1");
    check_status(dgfem_mvc_add_force(body, items, 1, bad, NULL), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "force");
    assert_int_equal(body->condition_count, 0);
    check_status(dgfem_mvc_pin(body, 0, 1, &id), DGFEM_OK);
    check_status(dgfem_mvc_move_fixture(body, id, matrix, zero), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "another kind");
    check_status(dgfem_mvc_drag(body, id + 1, zero), DGFEM_ERROR_INDEX);
    check_logged(&host, "no condition");
    check_status(dgfem_mvc_change_load(body, id, zero, 0), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "is not a load");
    check_status(dgfem_mvc_remove_condition(body, -1), DGFEM_ERROR_INDEX);
    check_logged(&host, "no condition");
    check_status(dgfem_mvc_set_gravity(body, bad), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "gravity");
    check_status(dgfem_mvc_add_plane(body, NULL, NULL), DGFEM_ERROR_DESCRIPTOR);
    shape.radius = 0;
    check_status(dgfem_mvc_add_sphere(body, &shape, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "radius");
    shape.plane.normal = zero;
    check_status(dgfem_mvc_add_plane(body, &shape, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "normal is zero");
    check_status(dgfem_mvc_move_shape(body, 99, &shape), DGFEM_ERROR_INDEX);
    check_logged(&host, "no shape");
    check_status(dgfem_mvc_step(body, 0, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "dt 0");
    check_status(dgfem_mvc_step(body, (dgfem_real)NAN, NULL), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "dt nan");
    check_status(dgfem_mvc_step(NULL, 1, NULL), DGFEM_ERROR_ARGUMENT);
    statics.load_steps = 0;
    check_status(dgfem_mvc_solve_static(body, &statics, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "0 load_steps");
    statics.cookie = 0;
    check_status(dgfem_mvc_solve_static(body, &statics, NULL), DGFEM_ERROR_DESCRIPTOR);
    check_status(dgfem_mvc_solve_static(body, NULL, NULL), DGFEM_ERROR_UNCONSTRAINED); /* one pin: it may turn */
    check_logged(&host, "node 0 free");
    check_status(dgfem_mvc_set_positions(body, dgfem_points_in_vec3(&zero, 1)), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "1 positions for 12 nodes");
    check_status(dgfem_mvc_stress(body, 2, &matrix), DGFEM_ERROR_INDEX);
    check_logged(&host, "element 2 of 2");
    check_status(dgfem_mvc_stress(body, 0, NULL), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_mvc_energy(body, NULL), DGFEM_ERROR_ARGUMENT);
    assert_int_equal(dgfem_mvc_face_nodes(body, -1, items, 2), 0);
    assert_int_equal(dgfem_mvc_element_nodes(body, 2, items, 2), 0);
    assert_int_equal(dgfem_mvc_face_nodes(body, 0, items, 2), 4);
    dgfem_mvc_destroy(body);
    dgfem_mvc_destroy(NULL);
    assert_int_equal(host.live, 0);
}

static void bad_fn(void *user, dgfem_vec3 rest, dgfem_vec3 *displacement) {
    (void)user, (void)rest;
    displacement->x = (dgfem_real)NAN;
}

/* A call that fails in its course has changed nothing. */
static void test_failing_solves(void **state) {
    (void)state;
    check_host host;
    dgfem_mvc_desc desc = mvc_desc();
    dgfem_mvc_static_desc statics = dgfem_default_mvc_static_desc();
    int id;
    desc.hooks = check_hooks(&host);
    desc.gravity = vec3(0, 0, -0.0005);
    dgfem_mvc *body = mvc_of(&desc, mvc_grid(6, 1, 1, 6, 1, 1));
    dgfem_vec3 first = body->position[3];
    int count, *nodes = nodes_on(body, plane_at(1, 0, 0, 0), &count);
    check_status(dgfem_mvc_fix_nodes_fn(body, nodes, count, DGFEM_MVC_XYZ, bad_fn, NULL, &id), DGFEM_OK);
    check_status(dgfem_mvc_step(body, 1, NULL), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "displacement of node");
    check_near3(body->position[3], first, 0);
    check_status(dgfem_mvc_remove_condition(body, id), DGFEM_OK);
    check_status(dgfem_mvc_fix_nodes(body, nodes, count, DGFEM_MVC_XYZ, vec3(0, 0, 0), NULL), DGFEM_OK);
    statics.max_sweeps = 1;
    check_status(dgfem_mvc_solve_static(body, &statics, NULL), DGFEM_ERROR_NOT_CONVERGED);
    check_logged(&host, "after 1 sweeps");
    for (int i = 0; i < body->node_count; i++) check_near3(body->position[i], body->rest[i], 0);
    for (int i = 0; i < 9; i++) check_near(body->rotation[2].m[i / 3][i % 3], i % 4 == 0, 0);
    check_status(dgfem_mvc_solve_static(body, NULL, NULL), DGFEM_OK);
    assert_true((double)body->position[dgfem_mvc_nearest_node(body, vec3(6, 0, 0))].z < -0.3);
    free(nodes);
    dgfem_mvc_destroy(body);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_rigid_motion),
        cmocka_unit_test(test_horn),
        cmocka_unit_test(test_linear_forces),
        cmocka_unit_test(test_forces_balance),
        cmocka_unit_test(test_tension),
        cmocka_unit_test(test_pressure),
        cmocka_unit_test(test_free_fall),
        cmocka_unit_test(test_step_is_implicit_euler),
        cmocka_unit_test(test_twist),
        cmocka_unit_test(test_pins_and_forces),
        cmocka_unit_test(test_friction),
        cmocka_unit_test(test_shapes),
        cmocka_unit_test(test_allocation_failures),
        cmocka_unit_test(test_body_allocation_failures),
        cmocka_unit_test(test_threads),
        cmocka_unit_test(test_bad_descriptors),
        cmocka_unit_test(test_bad_calls),
        cmocka_unit_test(test_failing_solves),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
