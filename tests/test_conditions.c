/* What holds and loads a body, against closed forms and balances of force. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check_solid.h"

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
    check_near3(dgfem_body_displacement(body, 0, vec3(0.3, 0.6, 0.9)), vec3(2, 0, -1),
                DGFEM_REAL_IS_FLOAT ? 1e-4 : 1e-9);
    dgfem_body_destroy(body);
}

/* Pressure on all sides turns with the body: it exerts no net force and no moment on a turned body, and damped
   steps end with the stress -p I. */
static void test_pressure_follows(void **state) {
    (void)state;
    const double p = 1e-3, pi = 3.14159265358979324;
    dgfem_body_desc desc = soft_desc();
    int faces[MAX_FACES];
    desc.damping_mass = 1;
    dgfem_body *body = make_box(&desc, 2, 2, 2, 1, 1, 1);
    int count = all_boundary_faces(body, faces);
    check_status(dgfem_body_set_pressure(body, faces, count, (dgfem_real)p, NULL), DGFEM_OK);
    check_status(dgfem_body_set_affine(body, rotation_minus_identity(1, 2, 3, pi / 2), vec3(1, 0, 0)), DGFEM_OK);
    for (int step = 0; step < 150; step++) check_status(dgfem_body_step(body, 1, NULL), DGFEM_OK);
    dgfem_vec3 linear, angular;
    check_status(dgfem_body_momentum(body, &linear, &angular), DGFEM_OK);
    check_near3(linear, vec3(0, 0, 0), 100 * CHECK_EPSILON);
    check_near3(angular, vec3(0, 0, 0), 100 * CHECK_EPSILON);
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
    desc.warp = 0;
    dgfem_body *body = make_box(&desc, 1, 1, 1, 1, 1, 1);
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
    check_near3(dgfem_body_displacement(body, 0, vec3(0.5, 0.5, 0.5)), vec3(0.005, 0.01, 0), 100 * CHECK_EPSILON);
    t = NAN;
    check_status(dgfem_body_resample_fixture(body, id), DGFEM_ERROR_NOT_FINITE);
    check_status(dgfem_body_move_fixture(body, id, vec3(1, 2, 3)), DGFEM_OK);
    solve(body);
    check_near3(dgfem_body_displacement(body, 0, vec3(0, 0.5, 1)), vec3(1, 2, 3), 1e3 * CHECK_EPSILON);
    check_status(dgfem_body_move_fixture(body, id + 1, vec3(1, 2, 3)), DGFEM_ERROR_INDEX);
    dgfem_body_destroy(body);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_symmetry_faces),        cmocka_unit_test(test_held_elements_are_exact),
        cmocka_unit_test(test_pins_carry_the_weight), cmocka_unit_test(test_dragged_pins),
        cmocka_unit_test(test_pressure_follows),      cmocka_unit_test(test_point_force),
        cmocka_unit_test(test_moving_fixture),
    };
    return cmocka_run_group_tests_name("conditions", tests, NULL, NULL);
}
