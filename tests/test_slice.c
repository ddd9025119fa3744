/* Slicing closed surfaces with a grid: volumes and areas, counts, voids, neighbours that must stay apart, bad input. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check.h"

typedef struct surface {
    double *vertices;
    int *triangles;
    int vertex_count, triangle_count;
} surface;

static surface surface_room(int vertices, int triangles) {
    surface s;
    s.vertices = (double *)calloc((size_t)vertices * 3, sizeof(double));
    s.triangles = (int *)calloc((size_t)triangles * 3, sizeof(int));
    s.vertex_count = s.triangle_count = 0;
    assert_non_null(s.vertices);
    assert_non_null(s.triangles);
    return s;
}

static void surface_free(surface *s) {
    free(s->vertices);
    free(s->triangles);
}

/* Appends a closed grid of around x tube quadrilaterals, each two triangles: a torus with radii r and t. */
static void add_torus(surface *s, int around, int tube, double r, double t, double x, double y, double z) {
    const double turn = 6.28318530717958648;
    int first = s->vertex_count;
    for (int i = 0; i < around; i++)
        for (int j = 0; j < tube; j++) {
            double a = turn * i / around, b = turn * j / tube, *v = s->vertices + 3 * s->vertex_count++;
            v[0] = x + (r + t * cos(b)) * cos(a), v[1] = y + (r + t * cos(b)) * sin(a), v[2] = z + t * sin(b);
        }
    for (int i = 0; i < around; i++)
        for (int j = 0; j < tube; j++) {
            int right = (i + 1) % around, up = (j + 1) % tube, *f = s->triangles + 3 * s->triangle_count;
            f[0] = first + i * tube + j, f[1] = first + right * tube + j, f[2] = first + right * tube + up;
            f[3] = first + i * tube + j, f[4] = first + right * tube + up, f[5] = first + i * tube + up;
            s->triangle_count += 2;
        }
}

/* Appends an axis-aligned box; flipped boxes are voids. */
static void add_box(surface *s, double x0, double y0, double z0, double size, int flip) {
    static const int faces[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
    int first = s->vertex_count;
    for (int k = 0; k < 8; k++) {
        double *v = s->vertices + 3 * s->vertex_count++;
        v[0] = x0 + size * (k & 1), v[1] = y0 + size * ((k >> 1) & 1), v[2] = z0 + size * (k >> 2);
    }
    for (int f = 0; f < 6; f++)
        for (int t = 0; t < 2; t++) {
            int *c = s->triangles + 3 * s->triangle_count++;
            c[0] = first + faces[f][0];
            c[1 + flip] = first + faces[f][1 + t];
            c[2 - flip] = first + faces[f][2 + t];
        }
}

static dgfem_slice_desc describe(const surface *s, int cells) {
    dgfem_slice_desc desc = dgfem_default_slice_desc();
    desc.vertices = dgfem_points_in_double(s->vertices, s->vertex_count);
    desc.triangles = s->triangles;
    desc.triangle_count = s->triangle_count;
    desc.cells = cells;
    return desc;
}

/* Slices, checks all invariants, and that nothing of the volume or area was lost. */
static dgfem_mesh *slice(const surface *s, int cells, double sliver, dgfem_slice_info *info) {
    dgfem_slice_desc desc = describe(s, cells);
    dgfem_mesh *mesh = NULL;
    desc.sliver = (dgfem_real)sliver;
    desc.info = info;
    check_status(dgfem_mesh_create_slices(&desc, &mesh), DGFEM_OK);
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    check_near(dgfem_mesh_volume(mesh) / info->surface_volume, 1, 4500 * CHECK_EPSILON); /* 1e-12 */
    check_near(dgfem_mesh_boundary_area(mesh) / info->surface_area, 1, 4500 * CHECK_EPSILON);
    return mesh;
}

static void test_torus(void **state) {
    (void)state;
    static const int cells[] = {1, 2, 3, 5, 8, 13, 21};
    surface s = surface_room(48 * 16, 2 * 48 * 16);
    add_torus(&s, 48, 16, 1, 0.4, 0.1, -0.2, 0.3);
    for (int k = 0; k < 7; k++)
        for (int slivers = 0; slivers < 2; slivers++) {
            dgfem_slice_info info;
            dgfem_mesh *mesh = slice(&s, cells[k], slivers ? 0 : 1e-3, &info);
            assert_int_equal(info.triangles, s.triangle_count);
            assert_int_equal(mesh->element_count, info.elements_raw - info.slivers_merged);
            if (slivers) assert_int_equal(info.slivers_merged, 0);
            dgfem_mesh_destroy(mesh);
        }
    surface_free(&s);
}

/* Every boundary face lies in the triangle that its tag names, and every triangle has faces. */
static void test_tags_name_triangles(void **state) {
    (void)state;
    dgfem_slice_info info;
    surface s = surface_room(24 * 8, 2 * 24 * 8);
    add_torus(&s, 24, 8, 1, 0.4, 0, 0, 0);
    dgfem_mesh *mesh = slice(&s, 6, 0, &info);
    double *area = (double *)calloc((size_t)s.triangle_count, sizeof *area);
    for (int f = 0; f < mesh->face_count; f++) {
        const dgfem_face *face = &mesh->faces[f];
        if (face->element[1] != DGFEM_NONE) {
            assert_int_equal(face->tag, DGFEM_NONE);
            continue;
        }
        assert_in_range(face->tag, 0, s.triangle_count - 1);
        area[face->tag] += (double)face->area;
    }
    for (int t = 0; t < s.triangle_count; t++) {
        const int *corner = s.triangles + 3 * t;
        const double *p = s.vertices + 3 * corner[0], *q = s.vertices + 3 * corner[1], *r = s.vertices + 3 * corner[2];
        double x = (q[1] - p[1]) * (r[2] - p[2]) - (q[2] - p[2]) * (r[1] - p[1]);
        double y = (q[2] - p[2]) * (r[0] - p[0]) - (q[0] - p[0]) * (r[2] - p[2]);
        double z = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
        double expected = sqrt(x * x + y * y + z * z) / 2;
        check_near(area[t], expected, 1000 * CHECK_EPSILON);
    }
    free(area);
    dgfem_mesh_destroy(mesh);
    surface_free(&s);
}

/* A box cut exactly into its cells: 27 of them, 54 inner faces. */
static void test_explicit_grid(void **state) {
    (void)state;
    surface s = surface_room(8, 12);
    dgfem_mesh *mesh = NULL;
    add_box(&s, 0, 0, 0, 3, 0);
    dgfem_slice_desc desc = describe(&s, 1);
    desc.use_grid = 1;
    desc.grid_cell.x = desc.grid_cell.y = desc.grid_cell.z = 1;
    desc.grid_cells[0] = desc.grid_cells[1] = desc.grid_cells[2] = 3;
    check_status(dgfem_mesh_create_slices(&desc, &mesh), DGFEM_OK);
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    assert_int_equal(mesh->element_count, 27);
    int interior = 0;
    for (int f = 0; f < mesh->face_count; f++) interior += mesh->faces[f].element[1] != DGFEM_NONE;
    assert_int_equal(interior, 54);
    for (int e = 0; e < 27; e++) check_near(mesh->elements[e].volume, 1, 100 * CHECK_EPSILON);
    dgfem_mesh_destroy(mesh);
    desc.grid_lower.x = 5; /* beside the box */
    check_status(dgfem_mesh_create_slices(&desc, &mesh), DGFEM_ERROR_EMPTY);
    surface_free(&s);
}

/* A hollow box in one cell keeps its void; in many it is a shell of cells. */
static void test_hollow_box(void **state) {
    (void)state;
    static const int cells[] = {1, 2, 3, 5, 7};
    surface s = surface_room(16, 24);
    add_box(&s, 0, 0, 0, 3, 0);
    add_box(&s, 1.1, 0.9, 1, 1, 1);
    for (int k = 0; k < 5; k++) {
        dgfem_slice_info info;
        dgfem_mesh *mesh = slice(&s, cells[k], 0, &info);
        check_near(dgfem_mesh_volume(mesh), 26, 1000 * CHECK_EPSILON);
        if (cells[k] == 1) assert_int_equal(mesh->element_count, 1);
        dgfem_mesh_destroy(mesh);
    }
    surface_free(&s);
}

/* Two boxes in one cell are two elements that do not touch. */
static void test_neighbours_stay_apart(void **state) {
    (void)state;
    surface s = surface_room(16, 24);
    dgfem_slice_info info;
    add_box(&s, 0, 0, 0, 1, 0);
    add_box(&s, 1.2, 0.2, 0.1, 1, 0);
    dgfem_mesh *mesh = slice(&s, 1, 0, &info);
    assert_int_equal(mesh->element_count, 2);
    for (int f = 0; f < mesh->face_count; f++) assert_int_equal(mesh->faces[f].element[1], DGFEM_NONE);
    dgfem_mesh_destroy(mesh);
    surface_free(&s);
}

/* Boxes that share an edge or a corner: balanced, though not a manifold. */
static void test_pinched_surfaces(void **state) {
    (void)state;
    for (int k = 0; k < 2; k++) {
        surface s = surface_room(16, 24);
        dgfem_slice_info info;
        add_box(&s, 0, 0, 0, 1, 0);
        add_box(&s, 1, 1, k ? 1 : 0, 1, 0);
        for (int t = 36; t < 72; t++) /* weld equal vertices */
            for (int v = 0; v < 8; v++)
                if (memcmp(s.vertices + 3 * v, s.vertices + 3 * s.triangles[t], 3 * sizeof(double)) == 0)
                    s.triangles[t] = v;
        for (int cells = 1; cells <= 5; cells++) {
            dgfem_mesh *mesh = slice(&s, cells, 0, &info);
            check_near(dgfem_mesh_volume(mesh), 2, 1000 * CHECK_EPSILON);
            dgfem_mesh_destroy(mesh);
        }
        surface_free(&s);
    }
}

/* The bunny of `make demo`, where it is there: element counts of the literature and of this project. */
static void test_bunny(void **state) {
    (void)state;
    static const int cells[] = {4, 11, 20}, elements[] = {44, 482, 2299};
    const char *path = getenv("DGFEM_BUNNY");
    FILE *file = fopen(path ? path : "build/bunny.obj", "r");
    surface s = surface_room(20000, 20000);
    char line[256];
    if (!file || DGFEM_REAL_IS_FLOAT) {
        if (file) fclose(file);
        surface_free(&s);
        print_message("no bunny here (make demo fetches it), or single precision: skipped\n");
        skip();
    }
    while (fgets(line, sizeof line, file)) {
        double *v = s.vertices + 3 * s.vertex_count;
        int *t = s.triangles + 3 * s.triangle_count;
        if (s.vertex_count < 20000 && sscanf(line, "v %lf %lf %lf", v, v + 1, v + 2) == 3) s.vertex_count++;
        else if (s.triangle_count < 20000 && sscanf(line, "f %d %d %d", t, t + 1, t + 2) == 3) {
            t[0]--, t[1]--, t[2]--;
            s.triangle_count++;
        }
    }
    fclose(file);
    assert_int_equal(s.triangle_count, 3674);
    for (int k = 0; k < 3; k++) {
        dgfem_slice_info info;
        dgfem_mesh *mesh = slice(&s, cells[k], 0, &info);
        assert_int_equal(mesh->element_count, elements[k]);
        dgfem_mesh_destroy(mesh);
    }
    surface_free(&s);
}

static void test_bad_input(void **state) {
    (void)state;
    check_host host;
    surface s = surface_room(8, 12);
    dgfem_mesh *mesh = NULL;
    add_box(&s, 0, 0, 0, 1, 0);
    dgfem_slice_desc good = describe(&s, 2), desc;
    good.hooks = check_hooks(&host);
    desc = good, desc.cookie = 0;
    check_status(dgfem_mesh_create_slices(&desc, &mesh), DGFEM_ERROR_DESCRIPTOR);
    desc = good, desc.triangle_count = 0;
    check_status(dgfem_mesh_create_slices(&desc, &mesh), DGFEM_ERROR_EMPTY);
    host.log_count = 0;
    desc = good, desc.cells = 0;
    check_status(dgfem_mesh_create_slices(&desc, &mesh), DGFEM_ERROR_ARGUMENT);
    host.log_count = 0;
    desc = good, desc.triangle_count = 11; /* without the last triangle */
    check_status(dgfem_mesh_create_slices(&desc, &mesh), DGFEM_ERROR_OPEN), check_logged(&host, "edge");
    double kept = s.vertices[16];
    s.vertices[16] = NAN;
    check_status(dgfem_mesh_create_slices(&good, &mesh), DGFEM_ERROR_NOT_FINITE), check_logged(&host, "vertex 5");
    s.vertices[16] = INFINITY;
    check_status(dgfem_mesh_create_slices(&good, &mesh), DGFEM_ERROR_NOT_FINITE), check_logged(&host, "vertex 5");
    s.vertices[16] = kept;
    int index = s.triangles[10];
    s.triangles[10] = 8;
    check_status(dgfem_mesh_create_slices(&good, &mesh), DGFEM_ERROR_INDEX), check_logged(&host, "triangle 3");
    s.triangles[10] = s.triangles[9];
    check_status(dgfem_mesh_create_slices(&good, &mesh), DGFEM_ERROR_DEGENERATE), check_logged(&host, "triangle 3");
    s.triangles[10] = index;
    for (int t = 0; t < 12; t++) {
        int swap = s.triangles[3 * t];
        s.triangles[3 * t] = s.triangles[3 * t + 1], s.triangles[3 * t + 1] = swap;
    }
    check_status(dgfem_mesh_create_slices(&good, &mesh), DGFEM_ERROR_INSIDE_OUT);
    host.log_count = 0;
    desc = good, desc.flip = 1;
    check_status(dgfem_mesh_create_slices(&desc, &mesh), DGFEM_OK);
    check_near(dgfem_mesh_volume(mesh), 1, 100 * CHECK_EPSILON);
    dgfem_mesh_destroy(mesh);
    assert_int_equal(host.live, 0);
    surface_free(&s);
}

static dgfem_status slice_with(void *context, const dgfem_hooks *hooks) {
    dgfem_slice_desc desc = describe((const surface *)context, 2);
    dgfem_mesh *mesh = NULL;
    desc.hooks = *hooks;
    dgfem_status status = dgfem_mesh_create_slices(&desc, &mesh);
    if (!status) dgfem_mesh_destroy(mesh);
    return status;
}

static void test_every_allocation(void **state) {
    (void)state;
    surface s = surface_room(12 * 6, 2 * 12 * 6);
    add_torus(&s, 12, 6, 1, 0.4, 0, 0, 0);
    assert_true(check_every_allocation(slice_with, &s) > 10);
    surface_free(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_torus),
        cmocka_unit_test(test_tags_name_triangles),
        cmocka_unit_test(test_explicit_grid),
        cmocka_unit_test(test_hollow_box),
        cmocka_unit_test(test_neighbours_stay_apart),
        cmocka_unit_test(test_pinched_surfaces),
        cmocka_unit_test(test_bunny),
        cmocka_unit_test(test_bad_input),
        cmocka_unit_test(test_every_allocation),
    };
    return cmocka_run_group_tests_name("slice", tests, NULL, NULL);
}
