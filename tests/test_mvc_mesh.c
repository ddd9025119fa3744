/* Nodes, faces and elements of dgfem_mvc.h: made from a cell complex, triangulated, measured, checked, changed. */
#define DGFEM_IMPLEMENTATION
#include "dgfem_mvc.h"
#include "check_mvc.h"

static dgfem_hooks quiet(void) {
    dgfem_hooks hooks;
    memset(&hooks, 0, sizeof hooks);
    return hooks;
}

/* The mesh of a cell complex, which is destroyed. */
static dgfem_mvci_mesh *complex_of(dgfem_mesh *source, const dgfem_hooks *hooks) {
    dgfem_mvci_mesh *mesh = NULL;
    check_status(dgfem_mvci_mesh_create(source, hooks, &mesh), DGFEM_OK);
    dgfem_mesh_destroy(source);
    return mesh;
}

static dgfem_mvci_mesh *box_of(int nx, int ny, int nz) {
    dgfem_hooks hooks = quiet();
    return complex_of(mvc_grid(nx, ny, nz, 1, 1, 1), &hooks);
}

/* ---- triangulation ---- */

/* Fills a polygon with points given as x, y, ...; nodes are numbered from `first`. Returns the number of triangles. */
static int triangulated(const double *points, int count, int first, dgfem_mvci_polygon *polygon) {
    dgfem_hooks hooks = quiet();
    memset(polygon, 0, sizeof *polygon);
    assert_true(dgfem_mvci_polygon_room(&hooks, polygon, count));
    polygon->count = count;
    polygon->flat = 16 * CHECK_EPSILON;
    for (int i = 0; i < count; i++) {
        polygon->node[i] = first + i;
        polygon->point[i][0] = points[2 * i], polygon->point[i][1] = points[2 * i + 1];
    }
    return dgfem_mvci_polygon_triangulate(polygon);
}

static double area_of(const dgfem_mvci_polygon *polygon, int first, int t) {
    const int *n = polygon->triangles + 3 * t;
    return dgfem_mvci_turn(polygon->point[n[0] - first], polygon->point[n[1] - first], polygon->point[n[2] - first]) /
           2;
}

/* Triangles cover the polygon, none is flat, each edge inside is used from both sides. */
static void check_triangulation(const double *points, int count, double area, double least) {
    dgfem_mvci_polygon polygon;
    dgfem_hooks hooks = quiet();
    int triangles = triangulated(points, count, 7, &polygon), uses[64][64];
    double sum = 0;
    memset(uses, 0, sizeof uses);
    assert_int_equal(triangles, count - 2);
    for (int t = 0; t < triangles; t++) {
        double part = area_of(&polygon, 7, t);
        assert_true(part > least);
        sum += part;
        for (int i = 0; i < 3; i++)
            uses[polygon.triangles[3 * t + i] - 7][polygon.triangles[3 * t + (i + 1) % 3] - 7]++;
    }
    check_near(sum, area, 1e-12);
    for (int i = 0; i < count; i++)
        for (int j = 0; j < count; j++) {
            int outer = j == (i + 1) % count, inner = i == (j + 1) % count;
            assert_int_equal(uses[i][j], inner ? 0 : outer ? 1 : uses[j][i]);
        }
    dgfem_mvci_polygon_free(&hooks, &polygon);
}

static void test_hanging_nodes_are_met(void **state) {
    (void)state;
    /* a triangle with three nodes on one side, two on another */
    const double sides[] = {0, 0, 0.25, 0, 0.5, 0, 0.75, 0, 1, 0, 2.0 / 3, 1.0 / 3, 1.0 / 3, 2.0 / 3, 0, 1};
    check_triangulation(sides, 8, 0.5, 1e-3);
    /* a square with a node in the middle of each side */
    const double square[] = {0, 0, 1, 0, 2, 0, 2, 1, 2, 2, 1, 2, 0, 2, 0, 1};
    check_triangulation(square, 8, 4, 0.1);
    /* one side only: all diagonals but those from the apex would pass through nodes */
    const double fan[] = {0, 0, 1, 0, 2, 0, 3, 0, 4, 0, 2, 1};
    check_triangulation(fan, 6, 2, 0.1);
    /* not convex: an L with nodes on its inner sides */
    const double ell[] = {0, 0, 2, 0, 2, 1, 1.5, 1, 1, 1, 1, 1.5, 1, 2, 0, 2};
    check_triangulation(ell, 8, 3, 0.05);
}

static void test_best_ears_come_first(void **state) {
    (void)state;
    dgfem_mvci_polygon polygon;
    dgfem_hooks hooks = quiet();
    /* a kite: its short diagonal gives better triangles */
    const double kite[] = {0, -1, 0.2, 0, 0, 1, -0.2, 0};
    assert_int_equal(triangulated(kite, 4, 0, &polygon), 2);
    for (int t = 0; t < 2; t++) {
        int has_1 = 0, has_3 = 0;
        for (int i = 0; i < 3; i++)
            has_1 |= polygon.triangles[3 * t + i] == 1, has_3 |= polygon.triangles[3 * t + i] == 3;
        assert_true(has_1 && has_3);
    }
    dgfem_mvci_polygon_free(&hooks, &polygon);
    /* four equal ears: that of the lowest node is cut, however the loop is turned */
    for (int turn = 0; turn < 4; turn++) {
        const double corner[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
        double points[8];
        for (int i = 0; i < 8; i++) points[i] = corner[(i / 2 + turn) % 4][i % 2];
        memset(&polygon, 0, sizeof polygon);
        assert_true(dgfem_mvci_polygon_room(&hooks, &polygon, 4));
        polygon.count = 4;
        for (int i = 0; i < 4; i++) {
            polygon.node[i] = 10 + (i + turn) % 4;
            memcpy(polygon.point[i], points + 2 * i, sizeof polygon.point[i]);
        }
        assert_int_equal(dgfem_mvci_polygon_triangulate(&polygon), 2);
        int *first = polygon.triangles, sum = first[0] + first[1] + first[2];
        assert_int_equal(sum, 10 + 11 + 13);
        dgfem_mvci_polygon_free(&hooks, &polygon);
    }
}

static void test_flat_polygons_are_refused(void **state) {
    (void)state;
    dgfem_mvci_polygon polygon;
    dgfem_hooks hooks = quiet();
    const double line[] = {0, 0, 1, 0, 2, 0, 1, 1e-14};
    assert_int_equal(triangulated(line, 4, 0, &polygon), 0);
    dgfem_mvci_polygon_free(&hooks, &polygon);
    const double turned[] = {0, 0, 0, 1, 1, 1, 1, 0};
    assert_int_equal(triangulated(turned, 4, 0, &polygon), 0);
    dgfem_mvci_polygon_free(&hooks, &polygon);
}

/* ---- from a cell complex ---- */

static void test_grid(void **state) {
    (void)state;
    dgfem_mvci_mesh *mesh = box_of(3, 2, 1);
    assert_int_equal(mesh->node_count, 24);
    assert_int_equal(mesh->element_count, 6);
    check_status(dgfem_mvci_mesh_check(mesh), DGFEM_OK);
    check_near(dgfem_mvci_mesh_volume(mesh), 1, 10 * CHECK_EPSILON);
    for (int e = 0; e < 6; e++) {
        dgfem_vec3 centre;
        dgfem_real diameter;
        check_near(dgfem_mvci_element_measure(mesh, e, &centre), 1.0 / 6, 10 * CHECK_EPSILON);
        check_near3(centre, vec3((e % 3 + 0.5) / 3, (e / 3 + 0.5) / 2, 0.5), 10 * CHECK_EPSILON);
        check_near(dgfem_mvci_element_area(mesh, e, &diameter), 2 * (1.0 / 6 + 1.0 / 3 + 0.5), 10 * CHECK_EPSILON);
        check_near(diameter, sqrt(1.0 / 9 + 0.25 + 1), 10 * CHECK_EPSILON);
        check_near(dgfem_mvci_element_star(mesh, e, centre, NULL), 1.0 / 72, 10 * CHECK_EPSILON);
    }
    dgfem_mvci_mesh_destroy(mesh);
}

static void test_quality(void **state) {
    (void)state;
    dgfem_hooks hooks = quiet();
    const double size[4][3] = {{1, 1, 1}, {1, 1, 0.01}, {1, 0.01, 0.01}, {2, 2, 2}};
    const double quality[4] = {1 / (2 * sqrt(3.0)), 3 * 0.01 / (2.04 * sqrt(2.0001)),
                               3 * 1e-4 / (0.0402 * sqrt(1.0002)), 1 / (2 * sqrt(3.0))};
    for (int k = 0; k < 4; k++) {
        dgfem_mvci_mesh *mesh = complex_of(mvc_grid(1, 1, 1, size[k][0], size[k][1], size[k][2]), &hooks);
        check_near((double)dgfem_mvci_element_quality(mesh, 0) / quality[k], 1, 100 * CHECK_EPSILON);
        dgfem_mvci_mesh_destroy(mesh);
    }
}

/* Nodes are corners: a cut face between two elements doubles it and the nodes that are not on the cut's front. */
static void test_cut_faces_come_apart(void **state) {
    (void)state;
    dgfem_hooks hooks = quiet();
    dgfem_mesh *source = mvc_grid(2, 1, 1, 1, 1, 1);
    int faces = source->face_count, cut = DGFEM_NONE;
    for (int f = 0; f < faces; f++)
        if (source->faces[f].element[1] != DGFEM_NONE) cut = f;
    source->faces[cut].cut = 1;
    dgfem_mvci_mesh *mesh = complex_of(source, &hooks);
    check_status(dgfem_mvci_mesh_check(mesh), DGFEM_OK);
    assert_int_equal(mesh->node_count, 16);
    assert_int_equal(mesh->face_count, faces + 1);
    assert_int_equal(mesh->faces[cut].owner[1], DGFEM_NONE);
    assert_int_equal(mesh->faces[faces].owner[1], DGFEM_NONE);
    assert_int_equal(mesh->faces[cut].wall + mesh->faces[faces].wall, 2);
    dgfem_mvci_mesh_destroy(mesh);

    source = mvc_grid(2, 2, 1, 1, 1, 1);
    for (int f = 0; f < source->face_count; f++)
        if (source->faces[f].element[1] != DGFEM_NONE && fabs((double)source->faces[f].normal.x) > 0.5 &&
            source->faces[f].centre.y < DGFEM_R(0.5))
            source->faces[f].cut = 1;
    mesh = complex_of(source, &hooks);
    check_status(dgfem_mvci_mesh_check(mesh), DGFEM_OK);
    assert_int_equal(mesh->node_count, 18 + 2);
    dgfem_mvci_mesh_destroy(mesh);
}

/* Tetrahedra, Voronoi cells, boxes cut by planes: volumes and numbers of triangles. */
static void test_meshes_of_all_kinds(void **state) {
    (void)state;
    dgfem_hooks hooks = quiet();
    for (int kind = 0; kind < MVC_KINDS; kind++) {
        dgfem_mvci_mesh *mesh = complex_of(mvc_mesh((mvc_kind)kind, 3, 5), &hooks);
        check_status(dgfem_mvci_mesh_check(mesh), DGFEM_OK);
        check_near(dgfem_mvci_mesh_volume(mesh), 1, 1000 * CHECK_EPSILON);
        int room = dgfem_mvci_max_element_corners(mesh);
        int *mark = (int *)malloc((size_t)mesh->node_count * sizeof(int));
        int *nodes = (int *)malloc((size_t)room * sizeof(int)),
            *triangles = (int *)malloc(3 * (size_t)room * sizeof(int));
        for (int i = 0; i < mesh->node_count; i++) mark[i] = DGFEM_NONE;
        for (int e = 0; e < mesh->element_count; e++) {
            int count = dgfem_mvci_element_nodes(mesh, e, mark, nodes);
            assert_int_equal(dgfem_mvci_element_triangles(mesh, e, triangles), 2 * count - 4);
        }
        free(mark), free(nodes), free(triangles);
        dgfem_mvci_mesh_destroy(mesh);
    }
}

/* A box with a square tunnel has faces with holes. */
static void test_holes_are_refused(void **state) {
    (void)state;
    check_host host;
    dgfem_hooks hooks = check_hooks(&host);
    dgfem_polyhedron_desc desc = dgfem_default_polyhedron_desc();
    dgfem_weld_desc weld = dgfem_default_weld_desc();
    dgfem_polyhedron *cell = NULL;
    dgfem_mesh *source = NULL;
    dgfem_mvci_mesh *mesh = NULL;
    dgfem_vec3 x[16];
    static const int loops[] = {0, 2, 3, 1, 8, 9, 11, 10, 4, 5,  7,  6, 12, 14, 15, 13, 0,  1,  5,  4,  1,  3,  7,  5,
                                3, 2, 6, 7, 2, 0, 4,  6,  8, 12, 13, 9, 9,  13, 15, 11, 11, 15, 14, 10, 10, 14, 12, 8};
    static const int starts[] = {0, 4, 8, 12, 16, 20, 24, 28, 32, 36, 40, 44, 48};
    static const int face_loops[] = {0, 2, 4, 5, 6, 7, 8, 9, 10, 11, 12};
    for (int i = 0; i < 16; i++) {
        double low = i < 8 ? 0 : 0.3, high = i < 8 ? 1 : 0.7;
        x[i] = vec3(i & 1 ? high : low, i & 2 ? high : low, i & 4 ? 1 : 0);
    }
    desc.vertices = x, desc.vertex_count = 16, desc.face_count = 10;
    desc.face_loops = face_loops, desc.loop_start = starts, desc.loop_vertices = loops;
    check_status(dgfem_polyhedron_create(&desc, &cell), DGFEM_OK);
    check_status(dgfem_mesh_create_polyhedra((const dgfem_polyhedron *const *)&cell, 1, &weld, &source), DGFEM_OK);
    check_status(dgfem_mvci_mesh_create(source, &hooks, &mesh), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "has 2 loops");
    assert_null(mesh);
    dgfem_mesh_destroy(source);
    dgfem_polyhedron_destroy(cell);
}

/* A long U does not see itself from its centroid. */
static void test_elements_must_be_star_shaped(void **state) {
    (void)state;
    check_host host;
    dgfem_hooks hooks = check_hooks(&host);
    dgfem_polyhedron_desc desc = dgfem_default_polyhedron_desc();
    dgfem_weld_desc weld = dgfem_default_weld_desc();
    dgfem_polyhedron *cell = NULL;
    dgfem_mesh *source = NULL;
    dgfem_mvci_mesh *mesh = NULL;
    const double outline[8][2] = {{0, 0}, {3, 0}, {3, 5}, {2, 5}, {2, 1}, {1, 1}, {1, 5}, {0, 5}};
    dgfem_vec3 x[16];
    int loops[48], starts[11], count = 0;
    for (int i = 0; i < 8; i++)
        x[i] = vec3(outline[i][0], outline[i][1], 0), x[8 + i] = vec3(outline[i][0], outline[i][1], 1);
    for (int i = 0; i < 8; i++) loops[i] = 7 - i, loops[8 + i] = 8 + i;
    starts[0] = 0, starts[1] = 8, count = 16;
    for (int i = 0; i < 8; i++) {
        int j = (i + 1) % 8;
        starts[2 + i] = count;
        loops[count++] = i, loops[count++] = j, loops[count++] = 8 + j, loops[count++] = 8 + i;
    }
    starts[10] = count;
    desc.vertices = x, desc.vertex_count = 16, desc.face_count = 10, desc.loop_start = starts,
    desc.loop_vertices = loops;
    check_status(dgfem_polyhedron_create(&desc, &cell), DGFEM_OK);
    check_status(dgfem_mesh_create_polyhedra((const dgfem_polyhedron *const *)&cell, 1, &weld, &source), DGFEM_OK);
    check_status(dgfem_mvci_mesh_create(source, &hooks, &mesh), DGFEM_ERROR_DEGENERATE);
    check_logged(&host, "element 0 is not star-shaped");
    dgfem_mesh_destroy(source);
    dgfem_polyhedron_destroy(cell);
}

/* A right triangle whose sides are far shorter than its distance from the point: 2^-60 (2^-24 in float) times that. */
static void test_small_triangles_are_measured(void **state) {
    (void)state;
    static const int nodes[3] = {0, 1, 2};
    dgfem_mvci_mesh *mesh = box_of(1, 1, 1);
    double side = DGFEM_REAL_IS_FLOAT ? 0x1p-12 : 0x1p-30;
    mesh->rest[0] = vec3(1, 0.5, 0.25);
    mesh->rest[1] = vec3(1, 0.5 + side, 0.25);
    mesh->rest[2] = vec3(1, 0.5, 0.25 + side);
    double volume = (double)dgfem_mvci_tetrahedron(mesh, nodes, vec3(0.3, 0.23, 0.11));
    check_near(volume / (side * side), 0.7, 10 * CHECK_EPSILON);
    dgfem_mvci_mesh_destroy(mesh);
}

/* A failed element is asked for more each time, until nothing is left; stages that change nothing are left out. */
static void test_failures_are_learned_from(void **state) {
    (void)state;
    dgfem_hooks hooks = quiet();
    dgfem_mvci_mesh *mesh = box_of(5, 1, 1);
    dgfem_plane plane = convex_mesh_plane(0, 0, 1, 0.5);
    for (int k = 0; k < 2; k++) {
        dgfem_mvci_splitter s;
        int times = 0;
        assert_true(dgfem_mvci_splitter_make(&s, &hooks, mesh, plane, 0, k ? 0 : DGFEM_R(0.05)));
        assert_true(dgfem_mvci_add_failed(&s, 2));
        while (dgfem_mvci_splitter_learn(&s, times) > 0) times++;
        assert_int_equal(times, k ? 2 : 6);
        assert_int_equal(s.stage[0], 0);
        assert_int_equal(s.stage[1], DGFEM_MVCI_WHOLE); /* shares edges with it */
        assert_int_equal(s.stage[2], DGFEM_MVCI_SEALED);
        assert_int_equal(s.stage[3], DGFEM_MVCI_WHOLE);
        dgfem_mvci_splitter_free(&s);
    }
    dgfem_mvci_mesh_destroy(mesh);
}

/* The middle one of 3 x 3 elements is sealed: a plane leaves the other eight whole, for they share an edge with it. Of
   5 x 1, it splits the two that do not. */
static void test_sealed_elements_do_not_change(void **state) {
    (void)state;
    for (int k = 0; k < 2; k++) {
        dgfem_hooks hooks = quiet();
        dgfem_mvci_mesh *mesh = k ? box_of(5, 1, 1) : box_of(3, 3, 1);
        dgfem_mvci_blade blade;
        dgfem_mvci_cracks cracks;
        dgfem_mvci_splitter s;
        int sealed = k ? 2 : 4;
        memset(&blade, 0, sizeof blade);
        memset(&cracks, 0, sizeof cracks);
        dgfem_mvci_blade_axes(&blade, vec3(0, 0, 1), vec3(0, 0, 0.5));
        assert_true(dgfem_mvci_splitter_make(&s, &hooks, mesh, blade.plane, 0, DGFEM_R(0.05)));
        s.stage[sealed] = DGFEM_MVCI_SEALED;
        assert_true(dgfem_mvci_seal_edges(&s, DGFEM_MVCI_WHOLE));
        dgfem_mvci_mesh *copy = dgfem_mvci_mesh_copy(mesh);
        check_status(dgfem_mvci_cut_attempt(&s, copy, &blade, 1, &cracks), DGFEM_OK);
        assert_int_equal(s.elements_split, k ? 2 : 0);
        assert_int_equal(s.elements_kept, k ? 3 : 9);
        assert_int_equal(copy->elements[sealed].changed, 0);
        assert_int_equal(copy->element_count, mesh->element_count + (k ? 2 : 0));
        assert_true(dgfem_mvci_mesh_compact(copy));
        check_status(dgfem_mvci_mesh_check(copy), DGFEM_OK);
        dgfem_mvci_cracks_free(&hooks, &cracks);
        dgfem_mvci_splitter_free(&s);
        dgfem_mvci_mesh_destroy(copy);
        dgfem_mvci_mesh_destroy(mesh);
    }
}

/* Parting faces changes no measure, not by round-off either. */
static void test_parting_keeps_measures(void **state) {
    (void)state;
    dgfem_hooks hooks = quiet();
    dgfem_mvci_mesh *mesh = box_of(3, 2, 2), *out = NULL;
    dgfem_mvci_blade blade;
    dgfem_mvc_cut_info info;
    memset(&info, 0, sizeof info);
    for (int open = 0; open < 2; open++) { /* splits, then parts what is split */
        memset(&blade, 0, sizeof blade);
        dgfem_mvci_blade_axes(&blade, dgfem_mvci_unit(vec3(0.31, 0.17, 1)), vec3(0.41, 0.53, 0.47));
        check_status(dgfem_mvci_mesh_cut(mesh, &blade, 0, 0, open, &info, &out), DGFEM_OK);
        assert_non_null(out);
        for (int e = 0; open && e < mesh->element_count; e++) {
            dgfem_vec3 before, after;
            assert_true(dgfem_mvci_element_measure(mesh, e, &before) == dgfem_mvci_element_measure(out, e, &after));
            assert_true(before.x == after.x && before.y == after.y && before.z == after.z);
        }
        assert_int_equal(out->element_count, open ? mesh->element_count : mesh->element_count + info.elements_split);
        dgfem_mvci_mesh_destroy(mesh);
        mesh = out;
    }
    assert_true(info.faces_cut > 3);
    assert_int_equal(info.elements_kept, 0);
    check_status(dgfem_mvci_mesh_check(mesh), DGFEM_OK);
    dgfem_mvci_blade_free(&hooks, &blade);
    dgfem_mvci_mesh_destroy(mesh);
}

static dgfem_status create_and_destroy(void *context, const dgfem_hooks *hooks) {
    dgfem_grid_desc *desc = (dgfem_grid_desc *)context;
    dgfem_mesh *source = NULL;
    dgfem_mvci_mesh *mesh = NULL;
    desc->hooks = *hooks;
    dgfem_status status = dgfem_mesh_create_grid(desc, &source);
    if (!status) status = dgfem_mvci_mesh_create(source, hooks, &mesh);
    dgfem_mesh_destroy(source);
    dgfem_mvci_mesh_destroy(mesh);
    return status;
}

/* A failure that is learned from until its element is sealed. */
static dgfem_status learn_to_the_end(void *context, const dgfem_hooks *hooks) {
    const dgfem_mvci_mesh *mesh = (const dgfem_mvci_mesh *)context;
    dgfem_mvci_splitter s;
    int learned = dgfem_mvci_splitter_make(&s, hooks, mesh, convex_mesh_plane(0, 0, 1, 0.5), 0, 0) ? 1 : -1;
    if (learned > 0 && !dgfem_mvci_add_failed(&s, 0)) learned = -1;
    for (int attempt = 0; learned > 0; attempt++) learned = dgfem_mvci_splitter_learn(&s, attempt);
    dgfem_mvci_splitter_free(&s);
    return learned ? dgfem_mvci_fail_memory(hooks) : DGFEM_OK;
}

static void test_every_failing_allocation(void **state) {
    (void)state;
    dgfem_grid_desc desc = dgfem_default_grid_desc();
    desc.cells[0] = 2;
    assert_true(check_every_allocation(create_and_destroy, &desc) > 20);
    dgfem_mvci_mesh *mesh = box_of(2, 1, 1);
    assert_true(check_every_allocation(learn_to_the_end, mesh) > 3);
    dgfem_mvci_mesh_destroy(mesh);
}

/* ---- changes ---- */

static int sameness(const dgfem_mvci_mesh *a, const dgfem_mvci_mesh *b) {
    int same = a->node_count == b->node_count && a->face_count == b->face_count && a->element_count == b->element_count;
    for (int f = 0; same && f < a->face_count; f++) {
        int count, other;
        const int *p = dgfem_mvci_face_loop(a, f, &count), *q = dgfem_mvci_face_loop(b, f, &other);
        same = count == other && !memcmp(p, q, (size_t)count * sizeof(int));
        p = dgfem_mvci_face_triangles(a, f, &count), q = dgfem_mvci_face_triangles(b, f, &other);
        same = same && count == other && !memcmp(p, q, 3 * (size_t)count * sizeof(int));
    }
    for (int i = 0; same && i < a->node_count; i++) same = check_distance(a->rest[i], b->rest[i]) == 0;
    return same;
}

static void test_copy_and_compact(void **state) {
    (void)state;
    dgfem_mvci_mesh *mesh = box_of(2, 2, 2), *copy = dgfem_mvci_mesh_copy(mesh);
    assert_non_null(copy);
    assert_true(sameness(mesh, copy));
    assert_true(dgfem_mvci_mesh_compact(copy));
    assert_true(sameness(mesh, copy));
    /* without its last element's faces it is gone, and what it had alone */
    int count;
    const int *faces = dgfem_mvci_element_faces(copy, 7, &count);
    for (int k = 0; k < count; k++) {
        dgfem_mvci_face *face = &copy->faces[faces[k] / 2];
        face->owner[faces[k] & 1] = DGFEM_NONE; /* of element 7 all inner sides are the second */
    }
    copy->elements[7].face_count = 0;
    assert_true(dgfem_mvci_mesh_compact(copy));
    check_status(dgfem_mvci_mesh_check(copy), DGFEM_OK);
    assert_int_equal(copy->node_count, 26);
    assert_int_equal(copy->face_count, mesh->face_count - 3);
    check_near(dgfem_mvci_mesh_volume(copy), 0.875, 10 * CHECK_EPSILON);
    dgfem_mvci_mesh_destroy(copy);
    dgfem_mvci_mesh_destroy(mesh);
}

/* A bent face becomes triangles; what lies on the other side has them too. */
static void test_bent_faces_are_divided(void **state) {
    (void)state;
    dgfem_mvci_mesh *mesh = box_of(2, 1, 1);
    int moved = DGFEM_NONE, faces = mesh->face_count;
    for (int i = 0; i < mesh->node_count; i++)
        if (check_distance(mesh->rest[i], vec3(0.5, 1, 1)) < 1e-5) moved = i;
    mesh->rest[moved].x += DGFEM_R(0.1);
    for (int f = 0; f < faces; f++) mesh->faces[f].triangle_count = 0;
    check_status(dgfem_mvci_mesh_settle(mesh, NULL), DGFEM_OK);
    assert_true(dgfem_mvci_mesh_compact(mesh));
    check_status(dgfem_mvci_mesh_check(mesh), DGFEM_OK);
    assert_int_equal(mesh->face_count, faces + 1); /* only the inner one */
    check_near(dgfem_mvci_mesh_volume(mesh), 1, 10 * CHECK_EPSILON);
    dgfem_mvci_mesh_destroy(mesh);
}

static void test_history(void **state) {
    (void)state;
    dgfem_mvci_mesh *mesh = box_of(1, 1, 1);
    char mark[16];
    dgfem_mvci_mesh_begin(mesh);
    int a = dgfem_mvci_add_node_between(mesh, 0, 1, DGFEM_R(0.25)),
        b = dgfem_mvci_add_node_between(mesh, a, 7, DGFEM_R(0.5));
    int c = dgfem_mvci_copy_node(mesh, a);
    memset(mark, 0, sizeof mark);
    mark[0] = mark[1] = 1;
    dgfem_mvci_mesh_inherit(mesh, mark);
    assert_int_equal(mark[mesh->origin[a]], 1);
    assert_int_equal(mark[mesh->origin[b]], 0);
    assert_int_equal(mark[mesh->origin[c]], 1);
    check_near3(mesh->rest[c],
                vec3(0.75 * (double)mesh->rest[0].x + 0.25 * (double)mesh->rest[1].x,
                     0.75 * (double)mesh->rest[0].y + 0.25 * (double)mesh->rest[1].y,
                     0.75 * (double)mesh->rest[0].z + 0.25 * (double)mesh->rest[1].z),
                CHECK_EPSILON);
    dgfem_mvci_mesh_destroy(mesh);
}

/* ---- the check ---- */

typedef enum damage {
    TURNED_FACE,
    LOST_FACE,
    FOREIGN_NODE,
    STALE_TRIANGLES,
    TURNED_TRIANGLE,
    MOVED_NODE,
    BENT_FACE,
    UNUSED_NODE,
    DAMAGES
} damage;

static void do_damage(dgfem_mvci_mesh *mesh, damage kind) {
    dgfem_mvci_face *face = &mesh->faces[0];
    int *loop = mesh->loops.data + face->loop, *triangle = mesh->triangles.data + face->triangle, swap = loop[0];
    if (kind == TURNED_FACE) loop[0] = loop[2], loop[2] = swap;
    if (kind == LOST_FACE) mesh->elements[0].face_count--;
    if (kind == FOREIGN_NODE) loop[0] = mesh->node_count;
    if (kind == STALE_TRIANGLES) triangle[0] = triangle[1];
    if (kind == TURNED_TRIANGLE) swap = triangle[0], triangle[0] = triangle[1], triangle[1] = swap;
    if (kind == MOVED_NODE) mesh->rest[loop[0]] = vec3(5, 5, 5);
    if (kind == BENT_FACE) mesh->rest[loop[0]].x += DGFEM_R(0.01);
    if (kind == UNUSED_NODE) (void)dgfem_mvci_copy_node(mesh, 0);
}

static void test_check_finds_damage(void **state) {
    (void)state;
    for (int kind = 0; kind < DAMAGES; kind++) {
        check_host host;
        dgfem_hooks hooks = check_hooks(&host);
        dgfem_mvci_mesh *mesh = complex_of(mvc_grid(2, 2, 2, 1, 1, 1), &hooks);
        check_status(dgfem_mvci_mesh_check(mesh), DGFEM_OK);
        do_damage(mesh, (damage)kind);
        check_status(dgfem_mvci_mesh_check(mesh), DGFEM_ERROR_INVARIANT);
        check_logged(&host, "invariant");
        dgfem_mvci_mesh_destroy(mesh);
        assert_int_equal(host.live, 0);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_hanging_nodes_are_met),
        cmocka_unit_test(test_best_ears_come_first),
        cmocka_unit_test(test_flat_polygons_are_refused),
        cmocka_unit_test(test_grid),
        cmocka_unit_test(test_quality),
        cmocka_unit_test(test_cut_faces_come_apart),
        cmocka_unit_test(test_meshes_of_all_kinds),
        cmocka_unit_test(test_holes_are_refused),
        cmocka_unit_test(test_elements_must_be_star_shaped),
        cmocka_unit_test(test_small_triangles_are_measured),
        cmocka_unit_test(test_failures_are_learned_from),
        cmocka_unit_test(test_sealed_elements_do_not_change),
        cmocka_unit_test(test_parting_keeps_measures),
        cmocka_unit_test(test_every_failing_allocation),
        cmocka_unit_test(test_copy_and_compact),
        cmocka_unit_test(test_bent_faces_are_divided),
        cmocka_unit_test(test_history),
        cmocka_unit_test(test_check_finds_damage),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
