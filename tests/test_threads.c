/* Bodies that a host's threads move: the same bits as without threads. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check.h"
#include "check_threads.h"

/* ---- hosts ---- */

enum { NO_WORKERS = 0, RAGGED = -1 };

static dgfem_hooks hooks_of(check_host *host, check_workers *workers, int count) {
    dgfem_hooks hooks = check_hooks(host);
    workers->count = count, workers->loops = 0;
    if (count == NO_WORKERS) return hooks;
    hooks.parallel_for = count == RAGGED ? check_ragged_parallel_for : check_parallel_for;
    hooks.parallel_for_user = count == RAGGED ? (void *)&workers->loops : (void *)workers;
    return hooks;
}

/* ---- bodies ---- */

typedef struct scene {
    dgfem_flux flux;
    dgfem_solver solver;
    int all_normals; /* what is held is so along its normal only */
    int with_cut;
} scene;

/* Mostly of degree 1, a fifth of others; in float, where sanitizers make large blocks dear, a twentieth. */
static dgfem_body *create(const scene *s, dgfem_hooks hooks) {
    enum { ELEMENTS = 8 * 7 * 6 };
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    dgfem_body_desc desc = dgfem_default_body_desc();
    check_random random = check_random_seeded(1);
    dgfem_material materials[ELEMENTS];
    dgfem_body *body = NULL;
    dgfem_plane left;
    dgfem_vec3 none;
    int degrees[ELEMENTS], faces[64], count, e, i;
    grid.cells[0] = 8, grid.cells[1] = 7, grid.cells[2] = 6;
    grid.upper.x = (dgfem_real)0.8, grid.upper.y = (dgfem_real)0.7, grid.upper.z = (dgfem_real)0.6;
    check_status(dgfem_mesh_create_grid(&grid, &desc.mesh), DGFEM_OK);
    for (e = 0; e < ELEMENTS; e++) {
        int kind = check_random_int(&random, 20);
        degrees[e] = kind == 0 ? 3 : kind < 4 && !DGFEM_REAL_IS_FLOAT ? 2 : 1;
        materials[e] = desc.material;
        materials[e].young = (dgfem_real)check_random_real(&random, 1e5, 4e5);
    }
    desc.degrees = degrees, desc.materials = materials;
    desc.flux = s->flux, desc.solver = s->solver;
    desc.solver_tolerance = (dgfem_real)0.01;
    desc.solver_iterations = 4000;
    desc.hooks = hooks;
    check_status(dgfem_body_create(&desc, &body), DGFEM_OK);
    memset(&left, 0, sizeof left);
    memset(&none, 0, sizeof none);
    left.normal.x = 1;
    count = dgfem_mesh_faces_on_plane(body->mesh, left, (dgfem_real)1e-4, faces, 64);
    assert_int_equal(count, 42);
    if (s->all_normals) check_status(dgfem_body_fix_normal(body, faces, count, NULL), DGFEM_OK);
    else check_status(dgfem_body_fix_faces(body, faces, count, none, NULL), DGFEM_OK);
    for (i = 0; i < body->basis_count; i++) {
        body->displacement[i] = check_random_vec3(&random, -0.003, 0.003);
        body->velocity[i] = check_random_vec3(&random, -0.1, 0.1);
    }
    return body;
}

/* Two steps, of which the second allocates nothing. */
static void move(dgfem_body *body, const check_host *host) {
    long calls;
    check_status(dgfem_body_step(body, (dgfem_real)0.002, NULL), DGFEM_OK);
    calls = host->calls;
    check_status(dgfem_body_step(body, (dgfem_real)0.002, NULL), DGFEM_OK);
    assert_int_equal(host->calls, calls);
}

static void cut_and_move(dgfem_body *body, const check_host *host) {
    dgfem_plane plane;
    dgfem_cut_info info;
    memset(&plane, 0, sizeof plane);
    plane.normal.x = (dgfem_real)0.6, plane.normal.y = (dgfem_real)0.8, plane.offset = (dgfem_real)0.52;
    check_status(dgfem_body_cut_plane(body, plane, NULL, &info), DGFEM_OK);
    assert_true(info.elements_split > 10);
    move(body, host);
}

static void check_same_motion(const dgfem_body *a, const dgfem_body *b) {
    size_t bytes = (size_t)a->basis_count * sizeof(dgfem_vec3);
    assert_int_equal(a->basis_count, b->basis_count);
    assert_memory_equal(a->displacement, b->displacement, bytes);
    assert_memory_equal(a->velocity, b->velocity, bytes);
    assert_memory_equal(a->rotation, b->rotation, (size_t)a->mesh->element_count * sizeof(dgfem_mat3));
}

/* ---- tests ---- */

static void workers_change_no_bit_of_a_motion(void **state) {
    static const scene scenes[3] = {{DGFEM_FLUX_IP, DGFEM_SOLVER_AUTO, 0, 1},
                                    {DGFEM_FLUX_BZ, DGFEM_SOLVER_PCG, 0, 0},
                                    {DGFEM_FLUX_IP, DGFEM_SOLVER_SWEEPS, 1, 0}};
    static const int counts[3][4] = {{2, RAGGED, 3, 7}, {RAGGED, 1, 2, 7}, {7, RAGGED, 2, 3}};
    int k, i;
    (void)state;
    for (k = 0; k < 3; k++) {
        check_host alone_host;
        check_workers none;
        dgfem_body *alone = create(&scenes[k], hooks_of(&alone_host, &none, NO_WORKERS));
        move(alone, &alone_host);
        if (scenes[k].with_cut) cut_and_move(alone, &alone_host);
        for (i = 0; i < (check_long() ? 4 : 1); i++) {
            check_host host;
            check_workers workers;
            long loops;
            dgfem_body *body = create(&scenes[k], hooks_of(&host, &workers, counts[k][i]));
            move(body, &host);
            loops = workers.loops;
            assert_true(loops > 10);
            if (scenes[k].with_cut) {
                cut_and_move(body, &host);
                assert_true(workers.loops > loops + 10);
            }
            check_same_motion(body, alone);
            dgfem_body_destroy(body);
        }
        dgfem_body_destroy(alone);
    }
}

static void workers_change_no_bit_of_a_static_solve(void **state) {
    static const scene s = {DGFEM_FLUX_IP, DGFEM_SOLVER_CHOLESKY, 0, 0};
    dgfem_static_desc desc = dgfem_default_static_desc();
    check_host hosts[2];
    check_workers workers[2];
    dgfem_body *bodies[2];
    int k;
    (void)state;
    desc.tolerance = (dgfem_real)0.1;
    for (k = 0; k < 2; k++) {
        bodies[k] = create(&s, hooks_of(&hosts[k], &workers[k], k ? 3 : NO_WORKERS));
        check_status(dgfem_body_solve_static(bodies[k], &desc, NULL), DGFEM_OK);
    }
    assert_true(workers[1].loops > 10);
    check_same_motion(bodies[0], bodies[1]);
    for (k = 0; k < 2; k++) dgfem_body_destroy(bodies[k]);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(workers_change_no_bit_of_a_motion),
        cmocka_unit_test(workers_change_no_bit_of_a_static_solve),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
