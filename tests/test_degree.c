/* Changing degrees while the body lives: what must be kept is kept, and the result is that of a body made so. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check.h"

static dgfem_body *make_body(const int *degrees, const dgfem_hooks *hooks) {
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    dgfem_body_desc desc = dgfem_default_body_desc();
    dgfem_shape_desc floor = dgfem_default_shape_desc();
    dgfem_plane wall = {{1, 0, 0}, 0};
    dgfem_vec3 zero = {0, 0, 0};
    dgfem_body *body = NULL;
    int faces[8], held = 3;
    grid.cells[0] = 4, grid.upper.x = 4;
    if (hooks) grid.hooks = desc.hooks = *hooks;
    check_status(dgfem_mesh_create_grid(&grid, &desc.mesh), DGFEM_OK);
    desc.degrees = degrees;
    check_status(dgfem_body_create(&desc, &body), DGFEM_OK);
    int count = dgfem_mesh_faces_on_plane(body->mesh, wall, DGFEM_R(1e-4), faces, 8);
    check_status(dgfem_body_fix_faces(body, faces, count, zero, NULL), DGFEM_OK);
    check_status(dgfem_body_fix_elements(body, &held, 1, NULL), DGFEM_OK);
    check_status(dgfem_body_add_force(body, 1, zero, zero, NULL), DGFEM_OK);
    floor.plane.offset = -10;
    check_status(dgfem_body_add_plane(body, &floor, NULL), DGFEM_OK);
    return body;
}

static void randomize(dgfem_body *body) {
    check_random random = check_random_seeded(3);
    for (int i = 0; i < body->basis_count; i++) {
        body->displacement[i] = check_random_vec3(&random, -0.1, 0.1);
        body->velocity[i] = check_random_vec3(&random, -1, 1);
    }
}

/* Raising changes no value of the fields; going back gives the same coefficients. */
static void test_raising_is_exact(void **state) {
    (void)state;
    const int low[4] = {1, 2, 1, 3}, high[4] = {3, 3, 1, 3};
    check_random random = check_random_seeded(4);
    dgfem_body *body = make_body(low, NULL);
    randomize(body);
    dgfem_vec3 x[4], u[4], v[4], back[64];
    assert_in_range(body->basis_count, 1, 64);
    memcpy(back, body->displacement, (size_t)body->basis_count * sizeof *back);
    for (int e = 0; e < 4; e++) {
        x[e] = check_random_vec3(&random, 0, 1), x[e].x += (dgfem_real)e;
        u[e] = dgfem_body_displacement(body, e, x[e]), v[e] = dgfem_body_velocity(body, e, x[e]);
    }
    int revision = body->revision;
    check_status(dgfem_body_set_degrees(body, high), DGFEM_OK);
    assert_int_equal(body->revision, revision + 1);
    for (int e = 0; e < 4; e++) {
        check_near3(dgfem_body_displacement(body, e, x[e]), u[e], 4 * CHECK_EPSILON);
        check_near3(dgfem_body_velocity(body, e, x[e]), v[e], 4 * CHECK_EPSILON);
    }
    check_status(dgfem_body_step(body, DGFEM_R(1e-6), NULL), DGFEM_OK);
    dgfem_body_destroy(body);

    body = make_body(low, NULL);
    randomize(body);
    check_status(dgfem_body_set_degrees(body, high), DGFEM_OK);
    check_status(dgfem_body_set_degrees(body, low), DGFEM_OK);
    for (int i = 0; i < body->basis_count; i++) check_near3(body->displacement[i], back[i], 1000 * CHECK_EPSILON);
    dgfem_body_destroy(body);
}

static void test_lowering_keeps_momentum(void **state) {
    (void)state;
    const int high[4] = {3, 2, 3, 2};
    dgfem_body *body = make_body(high, NULL);
    dgfem_vec3 before, after;
    randomize(body);
    check_status(dgfem_body_momentum(body, &before, NULL), DGFEM_OK);
    for (int e = 0; e < 4; e++) check_status(dgfem_body_set_degree(body, e, 1), DGFEM_OK);
    check_status(dgfem_body_momentum(body, &after, NULL), DGFEM_OK);
    check_near3(after, before, 1e5 * CHECK_EPSILON); /* of some thousands */
    assert_int_equal(body->basis_count, 16);
    dgfem_body_destroy(body);
}

/* The static solution of a body whose degrees were changed is that of a body made with them. */
static void test_same_as_made_so(void **state) {
    (void)state;
    const int low[4] = {1, 1, 1, 1}, mixed[4] = {2, 3, 1, 2};
    dgfem_static_desc solve = dgfem_default_static_desc();
    dgfem_body *changed = make_body(low, NULL), *made = make_body(mixed, NULL);
    check_status(dgfem_body_set_degrees(changed, mixed), DGFEM_OK);
    check_status(dgfem_body_solve_static(changed, &solve, NULL), DGFEM_OK);
    check_status(dgfem_body_solve_static(made, &solve, NULL), DGFEM_OK);
    assert_int_equal(changed->basis_count, made->basis_count);
    for (int i = 0; i < made->basis_count; i++) check_near3(changed->displacement[i], made->displacement[i], 1e3 * CHECK_EPSILON);
    dgfem_body_destroy(changed);
    dgfem_body_destroy(made);
}

static void test_failures_change_nothing(void **state) {
    (void)state;
    const int low[4] = {1, 2, 1, 3}, mixed[4] = {2, 3, 1, 2};
    check_host host;
    dgfem_hooks hooks = check_hooks(&host);
    dgfem_body *body = make_body(low, &hooks);
    check_status(dgfem_body_set_degree(body, 0, 4), DGFEM_ERROR_ARGUMENT), check_logged(&host, "degree 4");
    check_status(dgfem_body_set_degree(body, 4, 1), DGFEM_ERROR_INDEX), check_logged(&host, "element 4");
    dgfem_body before = *body;
    long calls = host.calls, fail = 1, live = host.live;
    for (;; fail++) {
        host.fail_from = host.calls + fail;
        dgfem_status status = dgfem_body_set_degrees(body, mixed);
        host.fail_from = 0;
        if (!status) break;
        check_status(status, DGFEM_ERROR_MEMORY);
        assert_memory_equal(&before, body, sizeof before);
        assert_int_equal(host.live, live);
    }
    assert_true(fail > 10 && host.calls > calls);
    dgfem_body_destroy(body);
    assert_int_equal(host.live, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_raising_is_exact),
        cmocka_unit_test(test_lowering_keeps_momentum),
        cmocka_unit_test(test_same_as_made_so),
        cmocka_unit_test(test_failures_change_nothing),
    };
    return cmocka_run_group_tests_name("degree", tests, NULL, NULL);
}
