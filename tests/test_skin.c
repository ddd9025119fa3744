/* Skin: positions and normals of a render mesh that follows a body. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check.h"
#include "check_body.h"
#include "check_threads.h"

static dgfem_body *cubes(int nx, int ny, int nz, const dgfem_hooks *hooks) {
    dgfem_grid_desc desc = dgfem_default_grid_desc();
    dgfem_mesh *mesh;
    desc.cells[0] = nx, desc.cells[1] = ny, desc.cells[2] = nz;
    desc.upper = vec3(nx, ny, nz);
    check_status(dgfem_mesh_create_grid(&desc, &mesh), DGFEM_OK);
    return check_body_create(mesh, NULL, 1, hooks);
}

/* A sphere of radius 0.9 about (1, 1, 1): n x n cells of each face of a cube, projected; two triangles per quad. */
enum { CELLS = 6, VERTICES = 6 * (CELLS + 1) * (CELLS + 1), TRIANGLES = 12 * CELLS * CELLS };

typedef struct ball {
    dgfem_vec3 vertices[VERTICES]; /* each cube face has its own: those along the edges appear twice or three times */
    int triangles[3 * TRIANGLES];
} ball;

static void make_ball(ball *b) {
    int vertex = 0, at = 0;
    for (int face = 0; face < 6; face++) {
        int axis = face / 2, first = vertex;
        double sign = face % 2 ? 1 : -1;
        for (int j = 0; j <= CELLS; j++)
            for (int i = 0; i <= CELLS; i++) {
                double c[3], norm;
                c[axis] = sign;
                c[(axis + 1) % 3] = sign * (2.0 * i / CELLS - 1); /* keeps the triangles outward on both sides */
                c[(axis + 2) % 3] = 2.0 * j / CELLS - 1;
                norm = sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]) / 0.9;
                b->vertices[vertex++] = vec3(1 + c[0] / norm, 1 + c[1] / norm, 1 + c[2] / norm);
            }
        for (int j = 0; j < CELLS; j++)
            for (int i = 0; i < CELLS; i++) {
                int v = first + i + (CELLS + 1) * j, w = v + CELLS + 1;
                b->triangles[at++] = v, b->triangles[at++] = v + 1, b->triangles[at++] = w;
                b->triangles[at++] = v + 1, b->triangles[at++] = w + 1, b->triangles[at++] = w;
            }
    }
}

static dgfem_skin_desc ball_desc(const ball *b) {
    dgfem_skin_desc desc = dgfem_default_skin_desc();
    desc.vertices = dgfem_points_in_vec3(b->vertices, VERTICES);
    desc.triangles = b->triangles, desc.triangle_count = TRIANGLES;
    return desc;
}

/* ---- positions ---- */

static void test_affine_motion(void **state) {
    check_random random = check_random_seeded(31);
    dgfem_body *body = cubes(2, 2, 2, NULL);
    ball b;
    dgfem_skin_desc desc;
    dgfem_skin *skin;
    (void)state;
    make_ball(&b);
    desc = ball_desc(&b);
    check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_OK);
    for (int v = 0; v < VERTICES; v++) check_near3(skin->positions[v], b.vertices[v], 4 * CHECK_EPSILON);
    for (int i = 0; i < 3; i++) {
        check_affine affine = check_random_affine(&random);
        check_set_affine(body, body->displacement, &affine);
        check_status(dgfem_skin_update(skin, body), DGFEM_OK);
        for (int v = 0; v < VERTICES; v++) {
            dgfem_vec3 rest = b.vertices[v], u = check_affine_at(&affine, rest), expected;
            expected.x = rest.x + u.x, expected.y = rest.y + u.y, expected.z = rest.z + u.z;
            check_near3(skin->positions[v], expected, 512 * CHECK_EPSILON);
        }
    }
    dgfem_skin_destroy(skin);
    check_body_destroy(body);
}

/* Vertices at the same place stay together whatever the body does: no cracks. */
static void test_no_cracks(void **state) {
    check_random random = check_random_seeded(32);
    dgfem_body *body = cubes(2, 2, 2, NULL);
    ball b;
    dgfem_skin_desc desc;
    dgfem_skin *skin;
    int pairs = 0;
    (void)state;
    make_ball(&b);
    desc = ball_desc(&b);
    check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_OK);
    for (int i = 0; i < body->basis_count; i++) body->displacement[i] = check_random_vec3(&random, -0.3, 0.3);
    check_status(dgfem_skin_update(skin, body), DGFEM_OK);
    for (int v = 0; v < VERTICES; v++)
        for (int w = v + 1; w < VERTICES; w++) {
            if (!(check_distance(b.vertices[v], b.vertices[w]) < 4 * CHECK_EPSILON)) continue;
            check_near3(skin->positions[v], skin->positions[w], 256 * CHECK_EPSILON);
            pairs++;
        }
    assert_int_equal(pairs, 12 * (CELLS - 1) + 8 * 3);
    dgfem_skin_destroy(skin);
    check_body_destroy(body);
}

/* ---- normals ---- */

/* At a cube's corner each of the three sides counts with its right angle, however it is cut into triangles: the normal
   is the diagonal. */
static void test_angle_weights(void **state) {
    static const double corners[8][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0},
                                         {0, 0, 1}, {1, 0, 1}, {0, 1, 1}, {1, 1, 1}};
    static const int triangles[36] = {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                                      2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5};
    dgfem_body *body = cubes(1, 1, 1, NULL);
    dgfem_skin_desc desc = dgfem_default_skin_desc();
    dgfem_skin *skin;
    check_affine turn;
    (void)state;
    desc.vertices = dgfem_points_in_double(&corners[0][0], 8);
    desc.triangles = triangles, desc.triangle_count = 12;
    check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_OK);
    for (int pass = 0; pass < 2; pass++) {
        for (int v = 0; v < 8; v++) {
            double d = 1 / sqrt(3.0), x = d * (2 * corners[v][0] - 1), y = d * (2 * corners[v][1] - 1);
            double z = d * (2 * corners[v][2] - 1);
            dgfem_vec3 expected = pass ? vec3(-y, x, z) : vec3(x, y, z);
            check_near3(skin->normals[v], expected, 64 * CHECK_EPSILON);
        }
        memset(&turn, 0, sizeof turn); /* a quarter turn about z */
        turn.linear.m[0][0] = turn.linear.m[1][1] = -1;
        turn.linear.m[0][1] = -1, turn.linear.m[1][0] = 1;
        check_set_affine(body, body->displacement, &turn);
        check_status(dgfem_skin_update(skin, body), DGFEM_OK);
    }
    dgfem_skin_destroy(skin);
    check_body_destroy(body);
}

/* Triangles without area say nothing; a vertex that has no other has no normal. */
static void test_degenerate_triangles(void **state) {
    static const double points[5][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0.5, 0, 0}, {1, 1, 1}};
    static const int triangles[9] = {0, 1, 2, 0, 3, 1, 4, 4, 4};
    dgfem_body *body = cubes(1, 1, 1, NULL);
    dgfem_skin_desc desc = dgfem_default_skin_desc();
    dgfem_skin *skin;
    (void)state;
    desc.vertices = dgfem_points_in_double(&points[0][0], 5);
    desc.triangles = triangles, desc.triangle_count = 3;
    check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_OK);
    for (int v = 0; v < 3; v++) check_near3(skin->normals[v], vec3(0, 0, 1), 4 * CHECK_EPSILON);
    check_near3(skin->normals[4], vec3(0, 0, 0), 0);
    dgfem_skin_destroy(skin);
    check_body_destroy(body);
}

static void test_same_bits_for_any_ranges(void **state) {
    check_random random = check_random_seeded(33);
    dgfem_body *body = cubes(2, 2, 2, NULL);
    static dgfem_vec3 positions[VERTICES], normals[VERTICES];
    ball b;
    dgfem_skin_desc desc;
    dgfem_skin *skin;
    long calls = 0;
    (void)state;
    make_ball(&b);
    desc = ball_desc(&b);
    for (int i = 0; i < body->basis_count; i++) body->displacement[i] = check_random_vec3(&random, -0.2, 0.2);
    check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_OK);
    memcpy(positions, skin->positions, sizeof positions);
    memcpy(normals, skin->normals, sizeof normals);
    dgfem_skin_destroy(skin);
    desc.hooks.parallel_for = check_ragged_parallel_for;
    desc.hooks.parallel_for_user = &calls;
    check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_OK);
    assert_true(calls >= 3);
    assert_memory_equal(positions, skin->positions, sizeof positions);
    assert_memory_equal(normals, skin->normals, sizeof normals);
    dgfem_skin_destroy(skin);
    check_body_destroy(body);
}

/* ---- buffers ---- */

static void test_strided_buffers(void **state) {
    dgfem_body *body = cubes(2, 2, 2, NULL);
    typedef struct vertex {
        float position[3], normal[3];
        int kept;
    } vertex;
    static vertex out[VERTICES];
    static double wide[4 * VERTICES];
    ball b;
    dgfem_skin_desc desc;
    dgfem_skin *skin;
    dgfem_points_out buffer;
    (void)state;
    make_ball(&b);
    desc = ball_desc(&b);
    check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_OK);
    for (int v = 0; v < VERTICES; v++) out[v].kept = 1000 + v, wide[4 * v + 3] = v;
    buffer.type = DGFEM_FLOAT32, buffer.stride = (int)sizeof(vertex), buffer.count = VERTICES;
    buffer.data = out[0].position;
    check_status(dgfem_skin_positions(skin, buffer), DGFEM_OK);
    buffer.data = out[0].normal;
    check_status(dgfem_skin_normals(skin, buffer), DGFEM_OK);
    buffer.data = wide, buffer.type = DGFEM_FLOAT64, buffer.stride = 32;
    check_status(dgfem_skin_positions(skin, buffer), DGFEM_OK);
    for (int v = 0; v < VERTICES; v++) {
        assert_int_equal(out[v].kept, 1000 + v);
        check_near(wide[4 * v + 3], v, 0);
        check_near(out[v].position[0], skin->positions[v].x, 2e-7);
        check_near(out[v].position[2], skin->positions[v].z, 2e-7);
        check_near(out[v].normal[1], skin->normals[v].y, 2e-7);
        check_near(wide[4 * v + 1], skin->positions[v].y, 0);
    }
    dgfem_skin_destroy(skin);
    check_body_destroy(body);
}

/* ---- what goes wrong ---- */

static void test_bad_descriptors(void **state) {
    check_host host;
    dgfem_hooks hooks = check_hooks(&host);
    dgfem_body *body = cubes(1, 1, 1, NULL);
    double points[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    int triangles[3] = {0, 1, 2};
    dgfem_skin_desc desc = dgfem_default_skin_desc();
    dgfem_skin *skin;
    (void)state;
    desc.hooks = hooks;
    desc.vertices = dgfem_points_in_double(points, 3);
    desc.triangles = triangles, desc.triangle_count = 1;
    triangles[1] = 3;
    check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_ERROR_INDEX);
    check_logged(&host, "triangle 0 names vertex 3 of 3");
    triangles[1] = -1;
    check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_ERROR_INDEX);
    check_logged(&host, "vertex -1");
    triangles[1] = 1;
    points[4] = (double)NAN;
    check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "point 1");
    points[4] = 0;
    desc.triangle_count = -1;
    check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "-1 triangles");
    desc.triangle_count = 1, desc.triangles = NULL;
    check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "no data for 1 triangles");
    desc.triangle_count = 0, desc.vertices.stride = 1;
    check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "stride");
    desc.vertices.stride = 0;
    check_status(dgfem_skin_create(NULL, &desc, &skin), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "no body");
    check_status(dgfem_skin_create(body, &desc, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "no result");
    desc.cookie = 0;
    check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_ERROR_DESCRIPTOR);
    assert_null(skin);
    check_status(dgfem_skin_create(body, NULL, &skin), DGFEM_ERROR_DESCRIPTOR);
    dgfem_skin_destroy(NULL);
    assert_int_equal(host.live, 0);
    check_body_destroy(body);
}

static void test_bad_calls(void **state) {
    check_host host;
    dgfem_hooks hooks = check_hooks(&host);
    dgfem_body *body = cubes(1, 1, 1, NULL);
    double points[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0}, out[9];
    dgfem_skin_desc desc = dgfem_default_skin_desc();
    dgfem_skin *skin;
    (void)state;
    desc.hooks = hooks;
    desc.vertices = dgfem_points_in_double(points, 3);
    check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_OK); /* without triangles: positions only */
    check_status(dgfem_skin_positions(skin, dgfem_points_out_double(out, 3)), DGFEM_OK);
    for (int i = 0; i < 9; i++) check_near(out[i], points[i], 4 * CHECK_EPSILON);
    check_status(dgfem_skin_normals(skin, dgfem_points_out_double(out, 3)), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "no triangles");
    check_status(dgfem_skin_positions(skin, dgfem_points_out_double(out, 2)), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "room for 2 of 3");
    check_status(dgfem_skin_positions(skin, dgfem_points_out_double(NULL, 3)), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "no data");
    check_status(dgfem_skin_positions(NULL, dgfem_points_out_double(out, 3)), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_skin_normals(NULL, dgfem_points_out_double(out, 3)), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_skin_update(NULL, body), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_skin_update(skin, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "no body");
    body->revision++;
    check_status(dgfem_skin_update(skin, body), DGFEM_ERROR_REVISION);
    check_logged(&host, "revision 0");
    dgfem_skin_destroy(skin);
    assert_int_equal(host.live, 0);
    check_body_destroy(body);
}

static dgfem_status create_and_destroy(void *context, const dgfem_hooks *hooks) {
    dgfem_body *body = (dgfem_body *)context;
    static const double points[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    static const int triangles[3] = {0, 1, 2};
    dgfem_skin_desc desc = dgfem_default_skin_desc();
    dgfem_skin *skin;
    dgfem_status status;
    desc.hooks = *hooks;
    desc.vertices = dgfem_points_in_double(points, 3);
    desc.triangles = triangles, desc.triangle_count = 1;
    body->mesh->hooks = *hooks;
    status = dgfem_skin_create(body, &desc, &skin);
    if (status == DGFEM_OK) {
        check_host *host = (check_host *)hooks->reallocate_user;
        long calls = host->calls;
        check_status(dgfem_skin_update(skin, body), DGFEM_OK);
        assert_int_equal(host->calls, calls); /* updates allocate nothing */
        dgfem_skin_destroy(skin);
    } else {
        assert_null(skin);
    }
    memset(&body->mesh->hooks, 0, sizeof body->mesh->hooks);
    return status;
}

static void test_allocation_failures(void **state) {
    dgfem_body *body = cubes(2, 1, 1, NULL);
    (void)state;
    print_message("%ld allocations\n", check_every_allocation(create_and_destroy, body));
    check_body_destroy(body);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_affine_motion),
        cmocka_unit_test(test_no_cracks),
        cmocka_unit_test(test_angle_weights),
        cmocka_unit_test(test_degenerate_triangles),
        cmocka_unit_test(test_same_bits_for_any_ranges),
        cmocka_unit_test(test_strided_buffers),
        cmocka_unit_test(test_bad_descriptors),
        cmocka_unit_test(test_bad_calls),
        cmocka_unit_test(test_allocation_failures),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
