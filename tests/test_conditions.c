/* What holds and loads a body, against closed forms and balances of force. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check.h"

static dgfem_vec3 vec3(double x, double y, double z) {
    dgfem_vec3 v;
    v.x = (dgfem_real)x, v.y = (dgfem_real)y, v.z = (dgfem_real)z;
    return v;
}

enum { MAX_FACES = 512 };

static dgfem_body *make_box(dgfem_body_desc *desc, int nx, int ny, int nz, double lx, double ly, double lz) {
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    dgfem_body *body = NULL;
    grid.cells[0] = nx, grid.cells[1] = ny, grid.cells[2] = nz;
    grid.upper = vec3(lx, ly, lz);
    check_status(dgfem_mesh_create_grid(&grid, &desc->mesh), DGFEM_OK);
    check_status(dgfem_body_create(desc, &body), DGFEM_OK);
    return body;
}

static dgfem_body_desc soft_desc(void) {
    dgfem_body_desc desc = dgfem_default_body_desc();
    desc.material.young = 1;
    desc.material.density = 1;
    desc.gravity = vec3(0, 0, 0);
    return desc;
}

/* Boundary faces by the side of the box that the grid tags them with (-x +x -y +y -z +z). */
static int faces_of_side(const dgfem_body *body, int side, int *faces) {
    int count = 0;
    for (int f = 0; f < body->mesh->face_count; f++)
        if (body->mesh->faces[f].element[1] == DGFEM_NONE && body->mesh->faces[f].tag == side) faces[count++] = f;
    assert_in_range(count, 1, MAX_FACES);
    return count;
}

static void solve(dgfem_body *body) {
    dgfem_static_desc desc = dgfem_default_static_desc();
    check_status(dgfem_body_solve_static(body, &desc, NULL), DGFEM_OK);
}

/* A bar between frictionless walls, pulled at its free end: one-dimensional strain t / (lambda + 2 mu). */
static void test_symmetry_faces(void **state) {
    (void)state;
    for (int degree = 1; degree <= 3; degree++)
        for (int warp = 0; warp < 2; warp++) {
            dgfem_body_desc desc = soft_desc();
            const double modulus = 0.7 / (1.3 * 0.4); /* E (1 - nu) / ((1 + nu)(1 - 2 nu)), nu = 0.3 */
            static const int sides[5] = {0, 2, 3, 4, 5};
            int faces[MAX_FACES];
            desc.degree = degree;
            desc.warp = warp;
            dgfem_body *body = make_box(&desc, 3, 2, 1, 2, 1, 1);
            for (int k = 0; k < 5; k++) {
                int count = faces_of_side(body, sides[k], faces);
                check_status(dgfem_body_fix_normal(body, faces, count, NULL), DGFEM_OK);
            }
            int count = faces_of_side(body, 1, faces);
            check_status(dgfem_body_set_traction(body, faces, count, vec3(0.01, 0, 0), NULL), DGFEM_OK);
            solve(body);
            dgfem_vec3 u = dgfem_body_displacement(body, 2, vec3(2, 0.3, 0.4));
            check_near3(u, vec3(0.01 * 2 / modulus, 0, 0), 1e4 * CHECK_EPSILON);
            dgfem_mat3 stress = dgfem_body_stress(body, 1, vec3(1, 0.5, 0.5));
            check_near(stress.m[0][0], 0.01, 1e4 * CHECK_EPSILON);
            check_near(stress.m[1][1], 0.01 * 0.3 / 0.7, 1e4 * CHECK_EPSILON);
            dgfem_body_destroy(body);
        }
}

static void test_held_elements_are_exact(void **state) {
    (void)state;
    dgfem_body_desc desc = dgfem_default_body_desc();
    int held[2] = {0, 3}, id;
    desc.material.young = DGFEM_R(1e6);
    dgfem_body *body = make_box(&desc, 4, 1, 1, 4, 1, 1);
    check_status(dgfem_body_fix_elements(body, held, 2, &id), DGFEM_OK);
    solve(body);
    for (int i = 0; i < 4; i++) {
        check_near3(body->displacement[body->basis_start[0] + i], vec3(0, 0, 0), 0);
        check_near3(body->displacement[body->basis_start[3] + i], vec3(0, 0, 0), 0);
    }
    assert_true(body->displacement[body->basis_start[1]].z < 0);

    static const dgfem_mat3 none = {{{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}};
    check_status(dgfem_body_move_elements(body, id, none, vec3(0.25, 0, 0.5)), DGFEM_OK);
    check_status(dgfem_body_step(body, DGFEM_R(0.125), NULL), DGFEM_OK);
    check_near3(dgfem_body_displacement(body, 3, vec3(3.5, 0.1, 0.9)), vec3(0.25, 0, 0.5), 10 * CHECK_EPSILON);
    check_near3(dgfem_body_velocity(body, 3, vec3(3.5, 0.1, 0.9)), vec3(2, 0, 4), 100 * CHECK_EPSILON);
    check_status(dgfem_body_step(body, DGFEM_R(0.125), NULL), DGFEM_OK);
    check_near3(dgfem_body_velocity(body, 0, vec3(0.5, 0.1, 0.9)), vec3(0, 0, 0), 100 * CHECK_EPSILON);
    dgfem_body_destroy(body);
}

/* Four springs carry the weight of a cube: their forces add up to it, whatever the cube does. */
static void test_pins_carry_the_weight(void **state) {
    (void)state;
    dgfem_body_desc desc = dgfem_default_body_desc();
    const double stiffness = 1e5;
    dgfem_vec3 corners[4];
    dgfem_body *body = make_box(&desc, 2, 2, 2, 1, 1, 1);
    double force = 0;
    for (int k = 0; k < 4; k++) {
        int element = (k & 1) + 2 * (k >> 1) + 4;
        corners[k] = vec3(k & 1, k >> 1, 1);
        check_status(dgfem_body_pin(body, element, corners[k], (dgfem_real)stiffness, NULL), DGFEM_OK);
    }
    solve(body);
    for (int k = 0; k < 4; k++) {
        int element = (k & 1) + 2 * (k >> 1) + 4;
        force -= stiffness * (double)dgfem_body_displacement(body, element, corners[k]).z;
    }
    check_near(force / (1000 * 9.81), 1, 1e6 * CHECK_EPSILON);
    dgfem_body_destroy(body);
}

/* In time the springs of a damped body settle at the same place, and follow their places when dragged. */
static void test_dragged_pins(void **state) {
    (void)state;
    dgfem_body_desc desc = dgfem_default_body_desc();
    int ids[8];
    desc.gravity = vec3(0, 0, 0);
    desc.damping_mass = 20;
    dgfem_body *body = make_box(&desc, 1, 1, 1, 1, 1, 1);
    for (int k = 0; k < 8; k++)
        check_status(dgfem_body_pin(body, 0, vec3(k & 1, (k >> 1) & 1, k >> 2), DGFEM_R(1e6), &ids[k]), DGFEM_OK);
    for (int k = 0; k < 8; k++)
        check_status(dgfem_body_drag(body, ids[k], vec3((k & 1) + 2, (k >> 1) & 1, (k >> 2) - 1)), DGFEM_OK);
    for (int step = 0; step < 400; step++) check_status(dgfem_body_step(body, DGFEM_R(0.02), NULL), DGFEM_OK);
    check_near3(dgfem_body_displacement(body, 0, vec3(0.3, 0.6, 0.9)), vec3(2, 0, -1), DGFEM_REAL_IS_FLOAT ? 1e-4 : 1e-9);
    dgfem_body_destroy(body);
}

/* Pressure on all sides: stress -p I at rest and after a turn, with no net force. */
static void test_pressure_follows(void **state) {
    (void)state;
    const double p = 1e-3;
    dgfem_body_desc desc = soft_desc();
    int faces[MAX_FACES], count = 0;
    dgfem_body *body = make_box(&desc, 2, 2, 2, 1, 1, 1);
    for (int f = 0; f < body->mesh->face_count; f++)
        if (body->mesh->faces[f].element[1] == DGFEM_NONE) faces[count++] = f;
    check_status(dgfem_body_set_pressure(body, faces, count, (dgfem_real)p, NULL), DGFEM_OK);
    for (int k = 0; k < 8; k++) /* weak springs that only keep it in place */
        check_status(dgfem_body_pin(body, k, vec3(k & 1, (k >> 1) & 1, k >> 2), DGFEM_R(1e-4), NULL), DGFEM_OK);
    static const dgfem_mat3 turn = {{{-1, -1, 0}, {1, -1, 0}, {0, 0, 0}}}; /* 90 degrees about z, minus the identity */
    check_status(dgfem_body_set_affine(body, turn, vec3(1, 0, 0)), DGFEM_OK);
    dgfem_vec3 before, after;
    check_status(dgfem_body_momentum(body, &before, NULL), DGFEM_OK);
    while (body->condition_count > 1)
        check_status(dgfem_body_remove_condition(body, body->conditions[1].id), DGFEM_OK);
    for (int step = 0; step < 2000; step++) check_status(dgfem_body_step(body, DGFEM_R(1.0), NULL), DGFEM_OK);
    check_status(dgfem_body_momentum(body, &after, NULL), DGFEM_OK);
    check_near3(after, before, 1e5 * CHECK_EPSILON);
    for (int e = 0; e < 8; e++) {
        dgfem_mat3 stress = dgfem_body_stress(body, e, body->mesh->elements[e].centre);
        for (int i = 0; i < 9; i++) check_near(stress.m[i / 3][i % 3], i % 4 ? 0 : -p, 1e-2 * p);
    }
    dgfem_body_destroy(body);
}

static void test_point_force(void **state) {
    (void)state;
    dgfem_body_desc desc = soft_desc();
    dgfem_vec3 p;
    int id;
    dgfem_body *body = make_box(&desc, 2, 1, 1, 2, 1, 1);
    check_status(dgfem_body_add_force(body, 1, vec3(1.7, 0.2, 0.9), vec3(1, 2, 3), &id), DGFEM_OK);
    check_status(dgfem_body_step(body, DGFEM_R(0.25), NULL), DGFEM_OK);
    check_status(dgfem_body_momentum(body, &p, NULL), DGFEM_OK);
    check_near3(p, vec3(0.25, 0.5, 0.75), 100 * CHECK_EPSILON); /* impulse */
    check_status(dgfem_body_remove_condition(body, id), DGFEM_OK);
    for (int i = 0; i < body->basis_count; i++) check_near3(body->force[i], vec3(0, 0, 0), 0);
    dgfem_body_destroy(body);
}

static void growing_shift(void *user, dgfem_vec3 rest, dgfem_vec3 *u) {
    double t = *(const double *)user;
    *u = vec3(t * (double)rest.y, t, 0);
}

static void test_moving_fixture(void **state) {
    (void)state;
    dgfem_body_desc desc = soft_desc();
    int faces[MAX_FACES], id;
    double t = 0;
    dgfem_body *body = make_box(&desc, 1, 1, 1, 1, 1, 1);
    desc.warp = 0;
    int count = 0;
    for (int f = 0; f < body->mesh->face_count; f++) faces[count++] = f;
    check_status(dgfem_body_fix_faces_fn(body, faces, count, growing_shift, &t, &id), DGFEM_OK);
    solve(body);
    check_near3(dgfem_body_displacement(body, 0, vec3(0.5, 0.5, 0.5)), vec3(0, 0, 0), 1e3 * CHECK_EPSILON);
    t = 0.01;
    solve(body); /* not yet sampled again */
    check_near3(dgfem_body_displacement(body, 0, vec3(0.5, 0.5, 0.5)), vec3(0, 0, 0), 1e3 * CHECK_EPSILON);
    check_status(dgfem_body_resample_fixture(body, id), DGFEM_OK);
    solve(body);
    check_near3(dgfem_body_displacement(body, 0, vec3(0.5, 0.5, 0.5)), vec3(0.005, 0.01, 0), 1e-4);
    t = NAN;
    check_status(dgfem_body_resample_fixture(body, id), DGFEM_ERROR_NOT_FINITE);
    check_status(dgfem_body_move_fixture(body, id, vec3(1, 2, 3)), DGFEM_OK);
    solve(body);
    check_near3(dgfem_body_displacement(body, 0, vec3(0, 0.5, 1)), vec3(1, 2, 3), 1e3 * CHECK_EPSILON);
    check_status(dgfem_body_move_fixture(body, id + 1, vec3(1, 2, 3)), DGFEM_ERROR_INDEX);
    dgfem_body_destroy(body);
}

/* Fixing and freeing again and again uses the same memory. */
static void test_removed_conditions_leave_nothing(void **state) {
    (void)state;
    check_host host;
    dgfem_body_desc desc = soft_desc();
    int faces[MAX_FACES], elements[2] = {0, 1}, id;
    desc.hooks = check_hooks(&host);
    dgfem_body *body = make_box(&desc, 2, 2, 2, 1, 1, 1);
    int count = faces_of_side(body, 0, faces);
    size_t data = 0;
    for (int round = 0; round < 10; round++) {
        check_status(dgfem_body_fix_faces(body, faces, count, vec3(0, 0, 0), &id), DGFEM_OK);
        check_status(dgfem_body_remove_condition(body, id), DGFEM_OK);
        check_status(dgfem_body_fix_elements(body, elements, 2, &id), DGFEM_OK);
        check_status(dgfem_body_remove_condition(body, id), DGFEM_OK);
        if (round == 0) data = body->forms->data_count;
    }
    assert_int_equal(body->forms->data_count, data);
    assert_int_equal(body->condition_count, 0);
    dgfem_body_destroy(body);
    assert_int_equal(host.live, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_symmetry_faces),
        cmocka_unit_test(test_held_elements_are_exact),
        cmocka_unit_test(test_pins_carry_the_weight),
        cmocka_unit_test(test_dragged_pins),
        cmocka_unit_test(test_pressure_follows),
        cmocka_unit_test(test_point_force),
        cmocka_unit_test(test_moving_fixture),
        cmocka_unit_test(test_removed_conditions_leave_nothing),
    };
    return cmocka_run_group_tests_name("conditions", tests, NULL, NULL);
}
