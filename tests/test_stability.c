/* The penalty's bound and search, against definiteness found by factorization. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check.h"

static dgfem_vec3 vec3(double x, double y, double z) {
    dgfem_vec3 v;
    v.x = (dgfem_real)x, v.y = (dgfem_real)y, v.z = (dgfem_real)z;
    return v;
}

/* A clamped box, cut by random planes. */
static dgfem_body *make_body(int degree, int planes, double stretch, dgfem_real eta, check_random *random) {
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    dgfem_body_desc desc = dgfem_default_body_desc();
    dgfem_body *body = NULL;
    int faces[256];
    grid.cells[0] = 2;
    grid.upper = vec3(2 * stretch, 1, 1);
    check_status(dgfem_mesh_create_grid(&grid, &desc.mesh), DGFEM_OK);
    for (int k = 0; k < planes; k++) {
        dgfem_plane plane;
        plane.normal = check_random_vec3(random, -1, 1);
        plane.offset = (dgfem_real)(stretch * (double)plane.normal.x + 0.5 * (double)plane.normal.y +
                                    0.5 * (double)plane.normal.z + check_random_real(random, -0.2, 0.2));
        check_status(dgfem_mesh_split_plane(desc.mesh, plane, DGFEM_R(0.02), NULL), DGFEM_OK);
    }
    desc.degree = degree;
    desc.eta = eta;
    desc.material.young = 1;
    check_status(dgfem_body_create(&desc, &body), DGFEM_OK);
    dgfem_plane wall = {{1, 0, 0}, 0};
    int count = dgfem_mesh_faces_on_plane(body->mesh, wall, DGFEM_R(1e-4), faces, 256);
    check_status(dgfem_body_fix_faces(body, faces, count, vec3(0, 0, 0), NULL), DGFEM_OK);
    return body;
}

static double largest_bound(const dgfem_body *body) {
    double largest = 0;
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfem_real theta = -1;
        check_status(dgfem_body_stability_bound(body, e, &theta), DGFEM_OK);
        assert_true(theta > 0);
        if ((double)theta > largest) largest = (double)theta;
    }
    return largest;
}

/* Whether the stiffness under unrelated random rotations of the elements can be factored. */
static int is_definite(dgfem_body *body, check_random *random) {
    dgfem_cholesky_info info;
    dgfem_mat3 *rotation = (dgfem_mat3 *)calloc((size_t)body->mesh->element_count, sizeof *rotation);
    dgfem_vec3 *f0 = (dgfem_vec3 *)calloc((size_t)body->basis_count, sizeof *f0);
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfem_mat3 f;
        for (int i = 0; i < 9; i++) f.m[i / 3][i % 3] = (dgfem_real)check_random_real(random, -1, 1);
        rotation[e] = dgfem_rotation_of(f, dgfemi_identity());
    }
    dgfemi_assemble_stiffness(body, rotation, 1, 0, body->matrix, f0);
    dgfem_status status = dgfem_cholesky_factor(body->cholesky, body->matrix, &info);
    free(rotation);
    free(f0);
    return status == DGFEM_OK;
}

/* eta a little above theta is enough, for boxes, stretched boxes and polyhedra, with any rotations. */
static void test_bound_suffices(void **state) {
    (void)state;
    check_random random = check_random_seeded(5);
    for (int degree = 1; degree <= (DGFEM_REAL_IS_FLOAT ? 1 : 3); degree++)
        for (int k = 0; k < 3; k++) {
            dgfem_body *body = make_body(degree, k == 2 ? 3 : 0, k == 1 ? 10 : 1, 4, &random);
            double theta = largest_bound(body);
            print_message("degree %d, %s: theta %.3f\n", degree, k == 0 ? "cubes" : k == 1 ? "1:10" : "polyhedra", theta);
            assert_true(theta < 4);
            check_status(dgfem_body_set_eta(body, (dgfem_real)(1.01 * theta)), DGFEM_OK);
            for (int round = 0; round < 5; round++) assert_true(is_definite(body, &random));
            dgfem_body_destroy(body);
        }
}

/* The bound does not depend on eta, size or material scale. */
static void test_bound_is_dimensionless(void **state) {
    (void)state;
    check_random random = check_random_seeded(6);
    dgfem_body *body = make_body(2, 0, 1, 4, &random);
    double theta = largest_bound(body);
    check_status(dgfem_body_set_eta(body, DGFEM_R(0.25)), DGFEM_OK);
    check_near(largest_bound(body), theta, 1e4 * CHECK_EPSILON);
    dgfem_body_destroy(body);
}

static void test_search_doubles_until_definite(void **state) {
    (void)state;
    check_random random = check_random_seeded(7);
    dgfem_real eta = 0;
    dgfem_body *body = make_body(1, 0, 1, DGFEM_R(0.01), &random);
    check_status(dgfem_body_find_eta(body, &eta), DGFEM_OK);
    print_message("eta found %g\n", (double)eta);
    assert_true((double)eta > 0.02 && (double)eta < 2 * largest_bound(body));
    check_near(body->desc.eta, eta, 0);
    dgfem_real again = 0;
    check_status(dgfem_body_find_eta(body, &again), DGFEM_OK);
    check_near(again, eta, 0);
    check_status(dgfem_body_set_eta(body, 0), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_body_stability_bound(body, 2, &eta), DGFEM_ERROR_INDEX);
    dgfem_body_destroy(body);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_bound_suffices),
        cmocka_unit_test(test_bound_is_dimensionless),
        cmocka_unit_test(test_search_doubles_until_definite),
    };
    return cmocka_run_group_tests_name("stability", tests, NULL, NULL);
}
