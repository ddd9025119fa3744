/* The penalty's bound and search, against definiteness found by factorization. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check_solid.h"

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
            print_message("degree %d, %s: theta %.3f\n", degree,
                          k == 0   ? "cubes"
                          : k == 1 ? "1:10"
                                   : "polyhedra",
                          theta);
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

/* A sphere of 960 triangles in 3 cells across, its lower half held: a curved surface is one patch, however many faces
   it has, so that the default penalty suffices. */
static void test_held_sphere(void **state) {
    (void)state;
    enum { AROUND = 32, RINGS = 15, VERTICES = AROUND * RINGS + 2, TRIANGLES = 2 * AROUND * RINGS };
    static dgfem_vec3 vertices[VERTICES];
    static int triangles[3 * TRIANGLES], faces[MAX_FACES];
    const double pi = 3.14159265358979324;
    int t = 0, count = 0;
    vertices[VERTICES - 2] = vec3(0, 0, -1), vertices[VERTICES - 1] = vec3(0, 0, 1);
    for (int ring = 0; ring < RINGS; ring++)
        for (int k = 0; k < AROUND; k++) {
            double a = 2 * pi * k / AROUND, b = pi * (ring + 1) / (RINGS + 1);
            int next = (k + 1) % AROUND, v = ring * AROUND;
            vertices[v + k] = vec3(sin(b) * cos(a), sin(b) * sin(a), -cos(b));
            if (ring == 0) triangles[t++] = VERTICES - 2, triangles[t++] = v + next, triangles[t++] = v + k;
            if (ring == RINGS - 1) {
                triangles[t++] = VERTICES - 1, triangles[t++] = v + k, triangles[t++] = v + next;
                continue;
            }
            triangles[t++] = v + k, triangles[t++] = v + next, triangles[t++] = v + AROUND + next;
            triangles[t++] = v + k, triangles[t++] = v + AROUND + next, triangles[t++] = v + AROUND + k;
        }
    assert_int_equal(t, 3 * TRIANGLES);
    for (int degree = 1; degree <= (DGFEM_REAL_IS_FLOAT ? 1 : 2); degree++) {
        dgfem_slice_desc slice = dgfem_default_slice_desc();
        dgfem_body_desc desc = dgfem_default_body_desc();
        dgfem_body *body = NULL;
        slice.vertices = dgfem_points_in_vec3(vertices, VERTICES);
        slice.triangles = triangles;
        slice.triangle_count = TRIANGLES;
        slice.cells = 3;
        check_status(dgfem_mesh_create_slices(&slice, &desc.mesh), DGFEM_OK);
        desc.degree = degree;
        check_status(dgfem_body_create(&desc, &body), DGFEM_OK);
        for (int f = count = 0; f < body->mesh->face_count; f++)
            if (body->mesh->faces[f].element[1] == DGFEM_NONE && body->mesh->faces[f].centre.z < 0) faces[count++] = f;
        assert_in_range(count, TRIANGLES / 2, MAX_FACES);
        check_status(dgfem_body_fix_faces(body, faces, count, vec3(0, 0, 0), NULL), DGFEM_OK);
        double theta = largest_bound(body);
        print_message("degree %d, held sphere: theta %.3f\n", degree, theta);
        assert_true(theta < 2.5);
        check_status(dgfem_body_step(body, DGFEM_R(0.01), NULL), DGFEM_OK);
        solve(body);
        double top = (double)dgfem_body_displacement(body, body->mesh->element_count - 1, vec3(0, 0, 0.9)).z;
        assert_true(top < 0 && top > -0.1);
        dgfem_body_destroy(body);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_bound_suffices),
        cmocka_unit_test(test_bound_is_dimensionless),
        cmocka_unit_test(test_held_sphere),
        cmocka_unit_test(test_search_doubles_until_definite),
    };
    return cmocka_run_group_tests_name("stability", tests, NULL, NULL);
}
