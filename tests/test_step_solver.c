/* The linear system of a step, solved by iteration: against Cholesky in every step. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check.h"

static const dgfem_solver iterative[3] = {DGFEM_SOLVER_AUTO, DGFEM_SOLVER_STALE, DGFEM_SOLVER_SWEEPS};

/* A box 4 x 1 x 1 of 10 x 3 x 3 hexahedra; in float, where sanitizers make steps dear, of 8 x 2 x 2. */
static dgfem_body *make_bar(const dgfem_body_desc *desc) {
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    dgfem_body_desc full = *desc;
    dgfem_body *body;
    grid.cells[0] = DGFEM_REAL_IS_FLOAT ? 8 : 10;
    grid.cells[1] = grid.cells[2] = DGFEM_REAL_IS_FLOAT ? 2 : 3;
    grid.lower = vec3(0, 0, 0), grid.upper = vec3(4, 1, 1);
    grid.hooks = desc->hooks;
    check_status(dgfem_mesh_create_grid(&grid, &full.mesh), DGFEM_OK);
    check_status(dgfem_body_create(&full, &body), DGFEM_OK);
    return body;
}

static void clamp(dgfem_body *body) {
    dgfem_plane plane;
    int faces[16];
    plane.normal = vec3(1, 0, 0), plane.offset = 0;
    int count = dgfem_mesh_faces_on_plane(body->mesh, plane, (dgfem_real)1e-4, faces, 16);
    check_status(dgfem_body_fix_faces(body, faces, count, vec3(0, 0, 0), NULL), DGFEM_OK);
}

/* The mean speed of the field v, as the kinetic energy has it. */
static double mean_speed(dgfem_body *body, const dgfem_vec3 *v) {
    size_t size = (size_t)body->basis_count * sizeof *v;
    dgfem_vec3 *kept = (dgfem_vec3 *)malloc(size);
    dgfem_energy energy;
    double mass = 0;
    assert_non_null(kept);
    memcpy(kept, body->velocity, size);
    memcpy(body->velocity, v, size);
    check_status(dgfem_body_energy(body, &energy), DGFEM_OK);
    memcpy(body->velocity, kept, size);
    for (int e = 0; e < body->mesh->element_count; e++)
        mass += (double)body->material[e].density * (double)body->mesh->elements[e].volume;
    free(kept);
    return sqrt(2 * (double)energy.kinetic / mass);
}

/* What one body does from the state of the other. */
static void copy_state(const dgfem_body *from, dgfem_body *to) {
    size_t size = (size_t)from->basis_count * sizeof *from->velocity;
    memcpy(to->displacement, from->displacement, size);
    memcpy(to->velocity, from->velocity, size);
    memcpy(to->rotation, from->rotation, (size_t)from->mesh->element_count * sizeof *from->rotation);
}

enum { HANGS, SPINS, FALLS, SCENES };

static void set_scene(dgfem_body *body, int scene) {
    if (scene == HANGS) clamp(body);
    for (int i = 0; scene == SPINS && i < body->mesh->element_count; i++) { /* about y, once in two seconds */
        dgfem_vec3 *v = body->velocity + body->basis_start[i];
        v[0].x = (dgfem_real)(3 * ((double)body->origin[i].z - 0.5));
        v[0].z = (dgfem_real)(-3 * ((double)body->origin[i].x - 2));
        v[3].x = 3 * body->scale[i], v[1].z = -3 * body->scale[i];
    }
    if (scene == FALLS) {
        dgfem_shape_desc floor = dgfem_default_shape_desc();
        floor.plane.normal = vec3(0.6, 0, 0.8);
        floor.plane.offset = (dgfem_real)-0.1;
        check_status(dgfem_body_add_plane(body, &floor, NULL), DGFEM_OK);
    }
}

/* From the same state each step of each solver ends near the exact one's, and costs few factorizations. */
static void test_velocities_are_within_the_tolerance(void **state) {
    enum { STEPS = DGFEM_REAL_IS_FLOAT ? 16 : 32 };
    const double dt = 1.0 / 60;
    (void)state;
    for (int scene = 0; scene < SCENES; scene++)
        for (int k = 0; k < 3; k++) {
            dgfem_body_desc desc = dgfem_default_body_desc();
            desc.material.young = (dgfem_real)2e5;
            desc.damping_stiffness = (dgfem_real)1e-3;
            desc.solver = DGFEM_SOLVER_CHOLESKY;
            dgfem_body *exact = make_bar(&desc);
            desc.solver = iterative[k];
            dgfem_body *body = make_bar(&desc);
            dgfem_vec3 *error = (dgfem_vec3 *)malloc((size_t)body->basis_count * sizeof *error);
            int factorizations = 0;
            double worst = 0;
            set_scene(exact, scene);
            set_scene(body, scene);
            for (int step = 0; step < STEPS; step++) {
                dgfem_step_info info;
                copy_state(exact, body);
                check_status(dgfem_body_step(exact, (dgfem_real)dt, &info), DGFEM_OK);
                assert_int_equal(info.factorizations, 1);
                check_status(dgfem_body_step(body, (dgfem_real)dt, &info), DGFEM_OK);
                factorizations += info.factorizations;
                for (int i = 0; i < body->basis_count; i++) {
                    error[i].x = body->velocity[i].x - exact->velocity[i].x;
                    error[i].y = body->velocity[i].y - exact->velocity[i].y;
                    error[i].z = body->velocity[i].z - exact->velocity[i].z;
                }
                double scale = fmax(mean_speed(body, exact->velocity), 0.01 * 0.29 / dt);
                worst = fmax(worst, mean_speed(body, error) / scale);
            }
            print_message("scene %d, solver %d: error %.1e, %d factorizations\n", scene, (int)iterative[k], worst,
                          factorizations);
            assert_true(worst < 3 * (double)desc.velocity_tolerance);
            assert_true(worst > 0);
            if (iterative[k] == DGFEM_SOLVER_SWEEPS) assert_int_equal(factorizations, 0);
            else assert_true(factorizations < (scene == FALLS ? STEPS * 3 / 4 : STEPS / 4));
            free(error);
            dgfem_body_destroy(exact);
            dgfem_body_destroy(body);
        }
}

/* Without warping the matrix stays the same: factored once, it solves every step in one iteration. */
static void test_a_linear_body_is_factored_once(void **state) {
    dgfem_body_desc desc = dgfem_default_body_desc();
    dgfem_step_info info;
    int factorizations = 0, iterations = 0;
    (void)state;
    desc.warp = 0;
    desc.material.young = (dgfem_real)1e7;
    dgfem_body *body = make_bar(&desc);
    clamp(body);
    for (int step = 0; step < 30; step++) {
        check_status(dgfem_body_step(body, DGFEM_R(0.01), &info), DGFEM_OK);
        factorizations += info.factorizations;
        iterations += info.iterations;
    }
    assert_int_equal(factorizations, 1);
    assert_in_range(iterations, 30, 32);
    dgfem_body_destroy(body);
}

/* However coarse the tolerance, what flies keeps its momentum: the pieces of a bar that springs apart, too. */
static void test_momentum_is_kept(void **state) {
    (void)state;
    for (int k = 0; k < 3; k++) {
        dgfem_body_desc desc = dgfem_default_body_desc();
        dgfem_piece pieces[2], before[2];
        dgfem_plane plane;
        int count;
        desc.solver = iterative[k];
        desc.velocity_tolerance = (dgfem_real)0.1;
        desc.gravity = vec3(0, 0, 0);
        dgfem_body *body = make_bar(&desc);
        set_scene(body, SPINS);
        for (int i = 0; i < body->basis_count; i += 4) body->displacement[i].x = (dgfem_real)(0.02 * (i % 3));
        plane.normal = vec3(1, 0, 0), plane.offset = (dgfem_real)1.3;
        check_status(dgfem_body_cut_plane(body, plane, NULL, NULL), DGFEM_OK);
        check_status(dgfem_body_pieces(body, NULL, before, 2, &count), DGFEM_OK);
        assert_int_equal(count, 2);
        for (int step = 0; step < 40; step++) check_status(dgfem_body_step(body, DGFEM_R(0.01), NULL), DGFEM_OK);
        check_status(dgfem_body_pieces(body, NULL, pieces, 2, &count), DGFEM_OK);
        for (int i = 0; i < 2; i++) {
            double tolerance = 1e5 * CHECK_EPSILON * (double)pieces[i].mass;
            check_near(pieces[i].momentum.x, (double)before[i].momentum.x, tolerance);
            check_near(pieces[i].momentum.y, (double)before[i].momentum.y, tolerance);
            check_near(pieces[i].momentum.z, (double)before[i].momentum.z, tolerance);
        }
        dgfem_body_destroy(body);
    }
}

/* A body at rest comes to rest: its steps need no more work than a moving one's. */
/* A body that falls freely gains the same velocity everywhere in each step: the first step finds it by moving the piece
   as a whole, the others by going on as before, also after cuts that split elements, join slivers with neighbours and
   let a piece go. */
static void test_free_fall_is_cheap_through_cuts(void **state) {
    const double dt = 1.0 / 60;
    (void)state;
    for (int k = 0; k < 3; k++) {
        dgfem_body_desc desc = dgfem_default_body_desc();
        dgfem_cut_desc blade = dgfem_default_cut_desc();
        desc.solver = iterative[k];
        blade.smallest = (dgfem_real)0.12;
        dgfem_body *body = make_bar(&desc);
        int slivers = 0;
        for (int i = 0; i < 6; i++) {
            dgfem_step_info info;
            if (i >= 2) {
                dgfem_plane plane = {{(dgfem_real)0.8, 0, (dgfem_real)0.6}, (dgfem_real)(0.9 + 0.25 * i)};
                dgfem_cut_info cut;
                if (i % 2) plane.normal = vec3(1, 0, 0), plane.offset = (dgfem_real)(0.51 + 0.4 * i);
                check_status(dgfem_body_cut_plane(body, plane, &blade, &cut), DGFEM_OK);
                slivers += cut.slivers_merged;
            }
            check_status(dgfem_body_step(body, (dgfem_real)dt, &info), DGFEM_OK);
            assert_in_range(info.iterations, 0, 1);
            for (int e = 0; e < body->mesh->element_count; e++) {
                dgfem_vec3 v = body->velocity[body->basis_start[e]];
                check_near((double)v.z, -9.81 * dt * (i + 1), DGFEM_REAL_IS_FLOAT ? 1e-4 : 1e-6);
            }
        }
        assert_true(slivers > 0);
        dgfem_body_destroy(body);
    }
}

static void test_rest_is_cheap(void **state) {
    dgfem_body_desc desc = dgfem_default_body_desc();
    dgfem_step_info info;
    (void)state;
    desc.material.young = (dgfem_real)1e6;
    desc.damping_mass = 4; /* critical */
    int factorizations = 0;
    dgfem_body *body = make_bar(&desc);
    clamp(body);
    for (int step = 0; step < 200; step++) {
        check_status(dgfem_body_step(body, DGFEM_R(0.04), &info), DGFEM_OK);
        if (step < 150) continue;
        assert_in_range(info.iterations, 0, 2);
        factorizations += info.factorizations;
    }
    assert_in_range(factorizations, 0, 3);
    double noise = 4000 * CHECK_EPSILON; /* of the elastic forces that hold the weight, m/s */
    assert_true(mean_speed(body, body->velocity) < fmax(2e-3 * 0.01 * 0.29 / 0.04, noise));
    dgfem_body_destroy(body);
}

/* Factorizations of a bar that spins in long and short steps by turns, after so many steps in which nothing moves. */
static int factorizations_after_rest(int rest) {
    dgfem_body_desc desc = dgfem_default_body_desc();
    dgfem_step_info info;
    int factorizations = 0;
    desc.solver = DGFEM_SOLVER_STALE;
    desc.gravity = vec3(0, 0, 0);
    dgfem_body *body = make_bar(&desc);
    for (int step = 0; step < rest; step++) check_status(dgfem_body_step(body, DGFEM_R(0.003), NULL), DGFEM_OK);
    set_scene(body, SPINS);
    for (int step = 0; step < 20; step++) {
        check_status(dgfem_body_step(body, step % 2 ? DGFEM_R(0.03) : DGFEM_R(0.003), &info), DGFEM_OK);
        factorizations += info.factorizations;
    }
    dgfem_body_destroy(body);
    return factorizations;
}

/* Steps without an iteration are no credit for more iterations than a factorization is worth. */
static void test_rest_is_no_credit(void **state) {
    (void)state;
    int factorizations = factorizations_after_rest(1);
    assert_true(factorizations > 2);
    assert_int_equal(factorizations_after_rest(60), factorizations);
}

/* A stiffness that is not positive definite: the step names the element and changes nothing; the next one works. */
static void test_failure_changes_nothing(void **state) {
    (void)state;
    for (int k = 0; k < 3; k++) {
        check_host host;
        dgfem_body_desc desc = dgfem_default_body_desc();
        dgfem_step_info info;
        desc.hooks = check_hooks(&host);
        desc.solver = iterative[k];
        desc.solver_iterations = 40;
        desc.material.young = (dgfem_real)1e8;
        dgfem_body *body = make_bar(&desc);
        clamp(body);
        for (int step = 0; step < 3; step++) check_status(dgfem_body_step(body, DGFEM_R(0.001), NULL), DGFEM_OK);
        size_t size = (size_t)body->basis_count * sizeof(dgfem_vec3);
        dgfem_vec3 *kept = (dgfem_vec3 *)malloc(2 * size);
        assert_non_null(kept);
        memcpy(kept, body->displacement, size);
        memcpy(kept + body->basis_count, body->velocity, size);
        check_status(dgfem_body_set_eta(body, (dgfem_real)1e-3), DGFEM_OK);
        dgfem_status status = dgfem_body_step(body, DGFEM_R(0.1), &info);
        check_status(status, DGFEM_ERROR_NOT_POSITIVE_DEFINITE);
        check_logged(&host, iterative[k] == DGFEM_SOLVER_SWEEPS ? "diagonal block of element" : "pivot of block");
        assert_in_range(info.failed_element, 0, body->mesh->element_count - 1);
        assert_memory_equal(kept, body->displacement, size);
        assert_memory_equal(kept + body->basis_count, body->velocity, size);
        check_status(dgfem_body_set_eta(body, 4), DGFEM_OK);
        check_status(dgfem_body_step(body, DGFEM_R(0.001), NULL), DGFEM_OK);
        free(kept);
        dgfem_body_destroy(body);
        assert_int_equal(host.live, 0);
    }
}

/* Sweeps that may not go on: the step tells how far they came and changes nothing. */
static void test_sweeps_that_do_not_converge(void **state) {
    check_host host;
    dgfem_body_desc desc = dgfem_default_body_desc();
    dgfem_step_info info;
    (void)state;
    desc.hooks = check_hooks(&host);
    desc.solver = DGFEM_SOLVER_SWEEPS;
    desc.solver_iterations = 2;
    desc.material.young = (dgfem_real)1e8;
    dgfem_body *body = make_bar(&desc);
    clamp(body);
    check_status(dgfem_body_step(body, DGFEM_R(0.1), &info), DGFEM_ERROR_NOT_CONVERGED);
    check_logged(&host, "after 2 iterations");
    assert_int_equal(info.iterations, 2);
    assert_int_equal(info.failed_element, DGFEM_NONE);
    check_near(body->time, 0, 0);
    for (int i = 0; i < body->basis_count; i++) {
        check_near(body->displacement[i].z, 0, 0);
        check_near(body->velocity[i].z, 0, 0);
    }
    dgfem_body_destroy(body);
    assert_int_equal(host.live, 0);
}

/* Once a factorization has been bought no step allocates; before, one that cannot changes nothing. */
static void test_memory(void **state) {
    (void)state;
    for (int k = 0; k < 3; k++) {
        check_host host;
        dgfem_body_desc desc = dgfem_default_body_desc();
        dgfem_plane plane;
        desc.hooks = check_hooks(&host);
        desc.solver = iterative[k];
        dgfem_body *body = make_bar(&desc);
        clamp(body);
        plane.normal = vec3(1, 0, 0), plane.offset = (dgfem_real)2.2;
        check_status(dgfem_body_cut_plane(body, plane, NULL, NULL), DGFEM_OK);
        host.fail_from = host.calls + 1;
        double time = body->time;
        dgfem_status status = dgfem_body_step(body, DGFEM_R(0.05), NULL);
        for (int step = 0; step < 10 && !status; step++) {
            time = body->time;
            status = dgfem_body_step(body, DGFEM_R(0.05), NULL);
        }
        if (status) {
            assert_true(iterative[k] == DGFEM_SOLVER_AUTO);
            check_status(status, DGFEM_ERROR_MEMORY);
            check_logged(&host, "out of memory");
            check_near(body->time, time, 0);
        }
        host.fail_from = 0;
        for (int step = 0; step < 20; step++) check_status(dgfem_body_step(body, DGFEM_R(0.05), NULL), DGFEM_OK);
        long calls = host.calls;
        for (int step = 0; step < 20; step++) check_status(dgfem_body_step(body, DGFEM_R(0.05), NULL), DGFEM_OK);
        assert_int_equal(host.calls, calls);
        dgfem_body_destroy(body);
        assert_int_equal(host.live, 0);
    }
}

static void test_bad_tolerances_are_refused(void **state) {
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    const double bad[3] = {0, -1, NAN};
    (void)state;
    for (int k = 0; k < 3; k++) {
        check_host host;
        dgfem_body_desc desc = dgfem_default_body_desc();
        dgfem_body *body;
        check_status(dgfem_mesh_create_grid(&grid, &desc.mesh), DGFEM_OK);
        desc.hooks = check_hooks(&host);
        desc.velocity_tolerance = (dgfem_real)bad[k];
        check_status(dgfem_body_create(&desc, &body), DGFEM_ERROR_ARGUMENT);
        check_logged(&host, "velocity_tolerance");
        dgfem_mesh_destroy(desc.mesh);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_velocities_are_within_the_tolerance),
        cmocka_unit_test(test_a_linear_body_is_factored_once),
        cmocka_unit_test(test_momentum_is_kept),
        cmocka_unit_test(test_free_fall_is_cheap_through_cuts),
        cmocka_unit_test(test_rest_is_cheap),
        cmocka_unit_test(test_rest_is_no_credit),
        cmocka_unit_test(test_failure_changes_nothing),
        cmocka_unit_test(test_sweeps_that_do_not_converge),
        cmocka_unit_test(test_memory),
        cmocka_unit_test(test_bad_tolerances_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
