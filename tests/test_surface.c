/* Surface: the exact boundary of the elements, cut walls included. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check.h"
#include "check_body.h"
#include "check_closed.h"
#include "shapes.h"

static dgfem_mesh *grid(int nx, int ny, int nz) {
    dgfem_grid_desc desc = dgfem_default_grid_desc();
    dgfem_mesh *mesh;
    desc.cells[0] = nx, desc.cells[1] = ny, desc.cells[2] = nz;
    desc.upper = vec3(nx, ny, nz);
    check_status(dgfem_mesh_create_grid(&desc, &mesh), DGFEM_OK);
    return mesh;
}

/* Splits along the plane and opens the faces in it whose centre lies at y <= limit. */
static int open_plane(dgfem_mesh *mesh, dgfem_plane plane, double limit) {
    int opened = 0;
    check_status(dgfem_mesh_split_plane(mesh, plane, 0, NULL), DGFEM_OK);
    for (int f = 0; f < mesh->face_count; f++) {
        dgfem_face *face = &mesh->faces[f];
        double off = (double)(dgfemi_dot(plane.normal, face->centre) - plane.offset);
        double along = fabs((double)dgfemi_dot(plane.normal, face->normal));
        if (face->element[1] == DGFEM_NONE || !(fabs(off) < 256 * CHECK_EPSILON) || !(along > 0.999)) continue;
        if ((double)face->centre.y > limit) continue;
        face->cut = 1;
        opened++;
    }
    return opened;
}

static check_closed shell_of(const dgfem_surface *surface) {
    check_closed shell;
    shell.positions = surface->positions, shell.triangles = surface->triangles, shell.key = surface->sample;
    shell.triangle_count = surface->triangle_count, shell.vertex_count = surface->vertex_count;
    return shell;
}

static int pieces_of(const dgfem_surface *surface) {
    check_closed shell = shell_of(surface);
    int *piece = (int *)malloc(sizeof(int) * (size_t)(surface->triangle_count + 1));
    int count = check_closed_pieces(&shell, piece);
    free(piece);
    return count;
}

/* Closed; triangles look out of their elements; area and volume are the mesh's and its walls'. */
static void check_surface(const dgfem_body *body, const dgfem_surface *surface) {
    const dgfem_mesh *mesh = body->mesh;
    check_closed shell = shell_of(surface);
    double area = (double)dgfem_mesh_boundary_area(mesh), volume = (double)dgfem_mesh_volume(mesh);
    for (int f = 0; f < mesh->face_count; f++)
        if (mesh->faces[f].element[1] != DGFEM_NONE && mesh->faces[f].cut) area += 2 * (double)mesh->faces[f].area;
    assert_int_equal(check_closed_open_edges(&shell), 0);
    check_near(check_closed_volume(&shell, NULL, 0), volume, 64 * CHECK_EPSILON * volume);
    check_near(check_closed_area(&shell, NULL, 0), area, 64 * CHECK_EPSILON * area);
    for (int t = 0; t < surface->triangle_count; t++) {
        const dgfem_face *face = &mesh->faces[surface->face[t]];
        assert_true(face->element[0] == surface->element[t] || face->element[1] == surface->element[t]);
        assert_int_equal(surface->source[t], face->tag);
        assert_true(face->element[1] == DGFEM_NONE || (face->cut && surface->wall[t]));
    }
}

static void test_box(void **state) {
    dgfem_body *body = check_body_create(grid(2, 2, 2), NULL, 1, NULL);
    dgfem_surface *surface;
    (void)state;
    check_status(dgfem_surface_create(body, &surface), DGFEM_OK);
    check_surface(body, surface);
    assert_int_equal(surface->triangle_count, 6 * 4 * 2);
    assert_int_equal(surface->vertex_count, 6 * 9); /* right angles are sharp */
    assert_int_equal(surface->embedding->sample_count, 26);
    for (int t = 0; t < surface->triangle_count; t++) {
        assert_int_equal(surface->wall[t], 0);
        for (int k = 0; k < 3; k++)
            check_near3(surface->normals[surface->triangles[3 * t + k]], body->mesh->faces[surface->face[t]].normal,
                        16 * CHECK_EPSILON);
    }
    dgfem_surface_destroy(surface);
    check_body_destroy(body);
}

/* A box cut through: two closed pieces; walls share no vertex with the outside. */
static void test_cut_through(void **state) {
    dgfem_plane plane;
    dgfem_mesh *mesh = grid(3, 2, 2);
    dgfem_body *body;
    dgfem_surface *surface;
    check_closed shell;
    int *wall_vertex;
    (void)state;
    plane.normal = vec3(0.8, 0.6, 0), plane.offset = DGFEM_R(1.55);
    assert_true(open_plane(mesh, plane, 10) > 0);
    body = check_body_create(mesh, NULL, 1, NULL);
    check_status(dgfem_surface_create(body, &surface), DGFEM_OK);
    check_surface(body, surface);
    shell = shell_of(surface);
    assert_int_equal(pieces_of(surface), 2);
    check_near(check_closed_area(&shell, surface->wall, 1), 2 * 2 * 2 / 0.8, 64 * CHECK_EPSILON);
    wall_vertex = (int *)calloc((size_t)surface->vertex_count, sizeof(int));
    for (int i = 0; i < 3 * surface->triangle_count; i++)
        wall_vertex[surface->triangles[i]] |= 1 + surface->wall[i / 3];
    for (int v = 0; v < surface->vertex_count; v++) assert_true(wall_vertex[v] == 1 || wall_vertex[v] == 2);
    free(wall_vertex);
    dgfem_surface_destroy(surface);
    check_body_destroy(body);
}

/* A slit: one piece, closed, open along the slit and shut at its end. */
static void test_slit(void **state) {
    dgfem_plane plane;
    dgfem_mesh *mesh = grid(2, 3, 2);
    dgfem_body *body;
    dgfem_surface *surface;
    (void)state;
    plane.normal = vec3(0, 0, 1), plane.offset = DGFEM_R(1.5);
    assert_int_equal(open_plane(mesh, plane, 2), 4);
    body = check_body_create(mesh, NULL, 1, NULL);
    check_status(dgfem_surface_create(body, &surface), DGFEM_OK);
    check_surface(body, surface);
    assert_int_equal(pieces_of(surface), 1);
    dgfem_surface_destroy(surface);
    check_body_destroy(body);
}

/* A sliced torus: the surface's own triangles come back as sources. */
static void test_slices(void **state) {
    static shape s;
    dgfem_slice_desc desc = dgfem_default_slice_desc();
    int triangles[3 * 512];
    dgfem_mesh *mesh;
    dgfem_body *body;
    dgfem_surface *surface;
    double area;
    (void)state;
    shape_torus(&s, 16, 10);
    for (int i = 0; i < s.corner_count; i++) triangles[i] = s.loop_vertices[i];
    desc.vertices = dgfem_points_in_vec3(s.vertices, s.vertex_count);
    desc.triangles = triangles, desc.triangle_count = s.corner_count / 3, desc.cells = 6;
    check_status(dgfem_mesh_create_slices(&desc, &mesh), DGFEM_OK);
    body = check_body_create(mesh, NULL, 1, NULL);
    check_status(dgfem_surface_create(body, &surface), DGFEM_OK);
    check_surface(body, surface);
    assert_int_equal(pieces_of(surface), 1);
    for (int t = 0; t < desc.triangle_count; t++) { /* each source is covered */
        check_closed shell = shell_of(surface);
        dgfem_vec3 a = s.vertices[triangles[3 * t]];
        area = 0.5 * (double)dgfemi_norm(dgfemi_cross(dgfemi_sub(s.vertices[triangles[3 * t + 1]], a),
                                                      dgfemi_sub(s.vertices[triangles[3 * t + 2]], a)));
        check_near(check_closed_area(&shell, surface->source, t), area, 4096 * CHECK_EPSILON);
    }
    dgfem_surface_destroy(surface);
    check_body_destroy(body);
}

/* Vertices follow their elements: affine fields exactly, and halves that part, each with its own. */
static void test_motion(void **state) {
    check_random random = check_random_seeded(41);
    check_affine affine = check_random_affine(&random);
    dgfem_plane plane;
    dgfem_mesh *mesh = grid(2, 2, 2);
    dgfem_body *body;
    dgfem_surface *surface;
    (void)state;
    plane.normal = vec3(1, 0, 0), plane.offset = DGFEM_R(0.7);
    (void)open_plane(mesh, plane, 10);
    body = check_body_create(mesh, NULL, 1, NULL);
    check_status(dgfem_surface_create(body, &surface), DGFEM_OK);
    check_set_affine(body, body->displacement, &affine);
    for (int e = 0; e < mesh->element_count; e++)
        if (mesh->elements[e].centre.x > plane.offset) body->displacement[body->basis_start[e]].z += 5;
    check_status(dgfem_surface_update(surface, body), DGFEM_OK);
    for (int t = 0; t < surface->triangle_count; t++)
        for (int k = 0; k < 3; k++) {
            int v = surface->triangles[3 * t + k];
            dgfem_vec3 x = surface->embedding->samples[surface->sample[v]];
            dgfem_vec3 expected = dgfemi_add(x, check_affine_at(&affine, x));
            if (mesh->elements[surface->element[t]].centre.x > plane.offset) expected.z += 5;
            check_near3(surface->positions[v], expected, 64 * CHECK_EPSILON);
        }
    dgfem_surface_destroy(surface);
    check_body_destroy(body);
}

static dgfem_status create(void *context, const dgfem_hooks *hooks) {
    dgfem_body *body = (dgfem_body *)context;
    dgfem_surface *surface;
    dgfem_hooks body_hooks = body->hooks, mesh_hooks = body->mesh->hooks;
    dgfem_status status;
    body->hooks = body->mesh->hooks = *hooks;
    status = dgfem_surface_create(body, &surface);
    assert_true((status == DGFEM_OK) == (surface != NULL));
    dgfem_surface_destroy(surface);
    body->hooks = body_hooks, body->mesh->hooks = mesh_hooks;
    return status;
}

static void test_failures(void **state) {
    check_host host;
    dgfem_hooks hooks = check_hooks(&host);
    dgfem_body *body = check_body_create(grid(2, 1, 1), NULL, 1, &hooks);
    dgfem_surface *surface;
    float buffer[3];
    (void)state;
    (void)check_every_allocation(create, body);
    check_status(dgfem_surface_create(NULL, &surface), DGFEM_ERROR_ARGUMENT);
    assert_null(surface);
    check_status(dgfem_surface_create(body, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "surface");
    check_status(dgfem_surface_create(body, &surface), DGFEM_OK);
    check_status(dgfem_surface_positions(surface, dgfem_points_out_float(buffer, 1)), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "room for 1");
    check_status(dgfem_surface_normals(NULL, dgfem_points_out_float(buffer, 1)), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_surface_update(surface, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "no body");
    body->revision++;
    check_status(dgfem_surface_update(surface, body), DGFEM_ERROR_REVISION);
    check_logged(&host, "revision");
    dgfem_surface_destroy(surface);
    dgfem_surface_destroy(NULL);
    check_body_destroy(body);
    assert_int_equal(host.live, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_box),    cmocka_unit_test(test_cut_through), cmocka_unit_test(test_slit),
        cmocka_unit_test(test_slices), cmocka_unit_test(test_motion),      cmocka_unit_test(test_failures),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
