/* Cutting a render mesh along with its body. Cuts of the body are made on its mesh, before the body is. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check.h"
#include "check_body.h"
#include "check_closed.h"
#include "shapes.h"

/* ---- models ---- */

typedef struct model {
    dgfem_body *body; /* after the cut */
    dgfem_skin *skin; /* before it, and moved */
    dgfem_skin *cut;
    dgfemi_blade blade;
    dgfem_hooks hooks;
    dgfem_plane rest; /* the blade's plane in the material */
} model;

static dgfem_mesh *grid(int nx, int ny, int nz, dgfem_vec3 lower, dgfem_vec3 upper) {
    dgfem_grid_desc desc = dgfem_default_grid_desc();
    dgfem_mesh *mesh;
    desc.cells[0] = nx, desc.cells[1] = ny, desc.cells[2] = nz;
    desc.lower = lower, desc.upper = upper;
    check_status(dgfem_mesh_create_grid(&desc, &mesh), DGFEM_OK);
    return mesh;
}

static int *triangles_of(const shape *s, int *count) {
    int *triangles = (int *)malloc(sizeof(int) * 3 * (size_t)s->corner_count);
    dgfem_polyhedron *p = shape_polyhedron(s);
    *count = 0;
    for (int f = 0; f < s->face_count; f++) {
        int n;
        check_status(dgfem_polyhedron_triangulate_face(p, f, triangles + 3 * *count, s->corner_count, &n), DGFEM_OK);
        *count += n;
    }
    dgfem_polyhedron_destroy(p);
    return triangles;
}

static dgfem_mesh *slices(const shape *s, int cells) {
    dgfem_slice_desc desc = dgfem_default_slice_desc();
    int count, *triangles = triangles_of(s, &count);
    dgfem_mesh *mesh;
    desc.vertices = dgfem_points_in_vec3(s->vertices, s->vertex_count);
    desc.triangles = triangles, desc.triangle_count = count, desc.cells = cells;
    check_status(dgfem_mesh_create_slices(&desc, &mesh), DGFEM_OK);
    free(triangles);
    return mesh;
}

static dgfemi_blade blade_of(dgfem_plane plane, const dgfem_vec3 *polygon, int count) {
    dgfemi_blade blade;
    blade.normal = plane.normal, blade.offset = plane.offset, blade.polygon = polygon, blade.polygon_count = count;
    return blade;
}

/* Splits the mesh along the plane and opens the faces there that the blade covers. */
static void open_mesh(dgfem_mesh *mesh, const dgfemi_blade *blade) {
    dgfem_plane plane;
    plane.normal = blade->normal, plane.offset = blade->offset;
    check_status(dgfem_mesh_split_plane(mesh, plane, 0, NULL), DGFEM_OK);
    for (int f = 0; f < mesh->face_count; f++) {
        dgfem_face *face = &mesh->faces[f];
        if (face->element[1] == DGFEM_NONE || !(fabs((double)dgfemi_dot(face->normal, plane.normal)) > 0.999)) continue;
        if (!(fabs((double)dgfemi_blade_distance(blade, face->centre)) < 1024 * CHECK_EPSILON)) continue;
        if (dgfemi_blade_covers(blade, face->centre)) face->cut = 1;
    }
}

/* A skin cut by one blade, the last one or not; the body stays, its faces have been opened. */
static dgfem_status cut_skin_by(const dgfem_skin *skin, const dgfem_body *body, const dgfemi_blade *blade, int last,
                                dgfem_skin **out) {
    dgfem_status status = DGFEM_OK;
    dgfemi_ints element;
    memset(&element, 0, sizeof element);
    for (int v = 0; !status && v < skin->vertex_count; v++)
        if (!dgfemi_push(&skin->hooks, &element, skin->embedding->point_element[v]))
            status = dgfemi_fail_memory(&skin->hooks);
    if (!status) status = dgfemi_skin_cut(skin, body, body, blade, last, skin->embedding, &element, out);
    dgfemi_free(&skin->hooks, element.data);
    return status;
}

static dgfem_status cut_skin(const dgfem_skin *skin, const dgfem_body *body, const dgfemi_blade *blade,
                             dgfem_skin **out) {
    return cut_skin_by(skin, body, blade, 1, out);
}

/* A skin of the shape on a body of the mesh, cut at rest. Takes the mesh over. */
static model cut_model(dgfem_mesh *mesh, const shape *s, dgfemi_blade blade, const dgfem_hooks *hooks) {
    dgfem_skin_desc desc = dgfem_default_skin_desc();
    model m;
    int *triangles = triangles_of(s, &desc.triangle_count);
    memset(&m, 0, sizeof m);
    open_mesh(mesh, &blade);
    m.blade = blade;
    m.body = check_body_create(mesh, NULL, 1, hooks);
    if (hooks) desc.hooks = *hooks;
    desc.vertices = dgfem_points_in_vec3(s->vertices, s->vertex_count), desc.triangles = triangles;
    check_status(dgfem_skin_create(m.body, &desc, &m.skin), DGFEM_OK);
    check_status(cut_skin(m.skin, m.body, &m.blade, &m.cut), DGFEM_OK);
    free(triangles);
    return m;
}

static void free_model(model *m) {
    dgfem_skin_destroy(m->skin);
    dgfem_skin_destroy(m->cut);
    check_body_destroy(m->body);
}

static dgfem_plane plane_of(double x, double y, double z, double offset) {
    dgfem_plane plane;
    double length = sqrt(x * x + y * y + z * z);
    plane.normal = vec3(x / length, y / length, z / length), plane.offset = (dgfem_real)(offset / length);
    return plane;
}

static check_closed shell_of(const dgfem_skin *skin, const int *identity) {
    check_closed shell;
    shell.positions = skin->positions, shell.triangles = skin->triangles;
    shell.key = skin->weld ? skin->weld : identity;
    shell.triangle_count = skin->triangle_count, shell.vertex_count = skin->vertex_count;
    return shell;
}

/* ---- what must hold after any cut ---- */

/* Old vertices and what the new ones come from. */
static void check_vertices(const dgfem_skin *before, const dgfem_skin *after, double tolerance) {
    int original = after->original_vertex_count;
    const dgfem_vec3 *rest = after->embedding->points;
    assert_int_equal(original, before->original_vertex_count);
    assert_true(after->vertex_count >= before->vertex_count);
    assert_memory_equal(rest, before->embedding->points, sizeof *rest * (size_t)before->vertex_count);
    for (int v = 0; v < after->vertex_count; v++) {
        int w = after->weld[v];
        assert_true(w >= 0 && w <= v && after->weld[w] == w);
        check_near3(after->positions[v], after->positions[w], tolerance);
        if (v >= original) {
            int a = after->parents[2 * (v - original)], b = after->parents[2 * (v - original) + 1];
            dgfem_real t = after->parent_weight[v - original];
            assert_true(a < v && b < v && (a == DGFEM_NONE) == (b == DGFEM_NONE));
            if (a == DGFEM_NONE) continue;
            assert_true(t >= 0 && t <= 1);
            check_near3(rest[v], dgfemi_add_scaled(rest[a], t, dgfemi_sub(rest[b], rest[a])), tolerance);
        }
    }
}

/* Every triangle is a part of its source, with the same normal; sources are covered. */
static void check_triangles(const dgfem_skin *before, const dgfem_skin *after, double tolerance) {
    double *area = (double *)calloc((size_t)before->triangle_count + 1, sizeof(double));
    const dgfem_vec3 *x = after->embedding->points, *y = before->embedding->points;
    for (int t = 0; t < after->triangle_count; t++) {
        const int *v = after->triangles + 3 * t;
        dgfem_vec3 n = dgfemi_cross(dgfemi_sub(x[v[1]], x[v[0]]), dgfemi_sub(x[v[2]], x[v[0]]));
        int source = after->source[t];
        assert_true((source == DGFEM_NONE) == (after->wall[t] != 0));
        for (int k = 0; k < 3; k++) assert_true(v[k] >= 0 && v[k] < after->vertex_count);
        if (source != DGFEM_NONE && before->cut_count == 0) {
            const int *w = before->triangles + 3 * source;
            dgfem_vec3 m = dgfemi_cross(dgfemi_sub(y[w[1]], y[w[0]]), dgfemi_sub(y[w[2]], y[w[0]]));
            area[source] += (double)dgfemi_norm(n);
            check_near(dgfemi_norm(dgfemi_sub(dgfemi_normalized(m), dgfemi_normalized(n))), 0, 1e6 * CHECK_EPSILON);
        }
    }
    for (int t = 0; before->cut_count == 0 && t < before->triangle_count; t++) {
        const int *w = before->triangles + 3 * t;
        dgfem_vec3 m = dgfemi_cross(dgfemi_sub(y[w[1]], y[w[0]]), dgfemi_sub(y[w[2]], y[w[0]]));
        check_near(area[t], dgfemi_norm(m), tolerance);
    }
    free(area);
}

/* Closed pieces whose volumes sum to the whole's; walls in pairs of equal area. Returns the number of pieces. */
static int check_pieces(const dgfem_skin *before, const dgfem_skin *after, double tolerance) {
    int *identity = (int *)malloc(sizeof(int) * (size_t)(before->vertex_count + 1));
    int *piece = (int *)malloc(sizeof(int) * (size_t)(after->triangle_count + 1)), count;
    check_closed a, b;
    double sum = 0;
    for (int v = 0; v < before->vertex_count; v++) identity[v] = v;
    a = shell_of(before, identity), b = shell_of(after, NULL);
    count = check_closed_pieces(&b, piece);
    assert_int_equal(check_closed_open_edges(&b), 0);
    for (int i = 0; i < count; i++) sum += check_closed_volume(&b, piece, i);
    check_near(sum, check_closed_volume(&a, NULL, 0), tolerance);
    check_near(check_closed_area(&b, after->wall, after->cut_count),
               check_closed_area(&b, after->wall, -after->cut_count), tolerance);
    check_vertices(before, after, tolerance);
    check_triangles(before, after, tolerance);
    free(identity);
    free(piece);
    return count;
}

/* Pulls what lies on the two sides apart and looks whether each vertex goes exactly with its own. Whole planes only. */
static void check_sides(const model *m, double tolerance) {
    const dgfem_mesh *mesh = m->body->mesh;
    int *side = (int *)calloc((size_t)m->cut->vertex_count, sizeof(int));
    for (int e = 0; e < mesh->element_count; e++) {
        int above = dgfemi_blade_side(&m->blade, mesh->elements[e].centre);
        m->body->displacement[m->body->basis_start[e]] = vec3(above ? 3 : -2, 1, above ? 5 : 7);
    }
    check_status(dgfem_skin_update(m->cut, m->body), DGFEM_OK);
    for (int t = 0; t < m->cut->triangle_count; t++)
        for (int k = 0; k < 3; k++) {
            int v = m->cut->triangles[3 * t + k];
            double d = (double)dgfemi_blade_distance(&m->blade, m->cut->embedding->points[v]);
            if (fabs(d) > 1e-3) side[v] |= d > 0 ? 2 : 1;
            if (m->cut->wall[t]) side[v] |= m->cut->wall[t] > 0 ? 2 : 1;
        }
    for (int pass = 0; pass < 2; pass++) /* others by the triangles that they are in */
        for (int t = 0; t < m->cut->triangle_count; t++) {
            const int *v = m->cut->triangles + 3 * t;
            int all = side[v[0]] | side[v[1]] | side[v[2]];
            assert_int_not_equal(all, 3);
            for (int k = 0; k < 3; k++) side[v[k]] = all;
        }
    for (int v = 0; v < m->cut->vertex_count; v++) {
        dgfem_vec3 u = dgfemi_sub(m->cut->positions[v], m->cut->embedding->points[v]);
        if (side[v]) check_near3(u, vec3(side[v] == 2 ? 3 : -2, 1, side[v] == 2 ? 5 : 7), tolerance);
    }
    memset(m->body->displacement, 0, sizeof *m->body->displacement * (size_t)m->body->basis_count);
    check_status(dgfem_skin_update(m->cut, m->body), DGFEM_OK);
    free(side);
}

/* ---- whole planes ---- */

static shape s0, s1;

static void test_cube(void **state) {
    static const double planes[][5] = {
        /* normal, offset, area of the section */
        {0, 0, 1, 0.4, 1},
        {1, 1, 1, 1.2, 0},
        {3, 1, -2, 0.7, 0},
        {1, -1, 0, 0, 1.4142135623730951}, /* through edges and diagonals */
        {1, 1, 1, 1, 0.8660254037844386},  /* through three vertices */
        {1, 0, 1, 1, 1.4142135623730951},
    };
    (void)state;
    shape_box(&s0, 0, 0, 0, 1, 1, 1);
    for (size_t i = 0; i < sizeof planes / sizeof *planes; i++) {
        dgfem_plane plane = plane_of(planes[i][0], planes[i][1], planes[i][2], planes[i][3]);
        model m = cut_model(grid(3, 3, 3, vec3(0, 0, 0), vec3(1, 1, 1)), &s0, blade_of(plane, NULL, 0), NULL);
        check_closed shell = shell_of(m.cut, NULL);
        assert_int_equal(check_pieces(m.skin, m.cut, 256 * CHECK_EPSILON), 2);
        if (planes[i][4] > 0) check_near(check_closed_area(&shell, m.cut->wall, 1), planes[i][4], 256 * CHECK_EPSILON);
        assert_int_equal(m.cut->cut_count, 1);
        check_sides(&m, 4096 * CHECK_EPSILON);
        free_model(&m);
    }
}

/* Blades that touch or miss: the same triangles, no walls. */
static void test_misses(void **state) {
    static const double planes[][4] = {{0, 0, 1, 2}, {0, 0, 1, 1}, {0, 0, -1, -1},
                                       {0, 0, 1, 0}, {1, 1, 1, 3}, {1, 1, 0, 2}};
    (void)state;
    shape_box(&s0, 0, 0, 0, 1, 1, 1);
    for (size_t i = 0; i < sizeof planes / sizeof *planes; i++) {
        dgfem_plane plane = plane_of(planes[i][0], planes[i][1], planes[i][2], planes[i][3]);
        model m = cut_model(grid(2, 2, 2, vec3(0, 0, 0), vec3(1, 1, 1)), &s0, blade_of(plane, NULL, 0), NULL);
        assert_int_equal(check_pieces(m.skin, m.cut, 256 * CHECK_EPSILON), 1);
        assert_int_equal(m.cut->vertex_count, 8);
        assert_int_equal(m.cut->triangle_count, 12);
        assert_int_equal(m.cut->cut_count, 0);
        assert_memory_equal(m.cut->triangles, m.skin->triangles, 36 * sizeof(int));
        for (int v = 0; v < 8; v++) check_near3(m.cut->positions[v], s0.vertices[v], 8 * CHECK_EPSILON);
        free_model(&m);
    }
}

/* A sphere of triangles: rings between two poles. */
static void make_ball(shape *s, int rings, int sides) {
    const double pi = 3.14159265358979324;
    int top, bottom;
    shape_begin(s);
    for (int i = 1; i < rings; i++)
        for (int k = 0; k < sides; k++) {
            double a = pi * i / rings, b = 2 * pi * k / sides;
            shape_vertex(s, sin(a) * cos(b), sin(a) * sin(b), cos(a));
        }
    top = shape_vertex(s, 0, 0, 1), bottom = shape_vertex(s, 0, 0, -1);
    for (int k = 0; k < sides; k++) {
        int n = (k + 1) % sides, last = (rings - 2) * sides;
        shape_triangle(s, top, k, n);
        shape_triangle(s, bottom, last + n, last + k);
        for (int i = 0; i + 2 < rings; i++) {
            shape_triangle(s, i * sides + k, (i + 1) * sides + k, (i + 1) * sides + n);
            shape_triangle(s, i * sides + k, (i + 1) * sides + n, i * sides + n);
        }
    }
}

static void test_ball(void **state) {
    static const double planes[][4] = {{0, 0, 1, 0.31}, {0, 0, 1, 0}, {1, 0, 0, 0}, {1, 2, 3, 0.4}, {0.3, 1, 0, 0}};
    (void)state;
    make_ball(&s0, 16, 24);
    for (size_t i = 0; i < sizeof planes / sizeof *planes; i++) {
        dgfem_plane plane = plane_of(planes[i][0], planes[i][1], planes[i][2], planes[i][3]);
        model m = cut_model(slices(&s0, 4), &s0, blade_of(plane, NULL, 0), NULL);
        assert_int_equal(check_pieces(m.skin, m.cut, 1024 * CHECK_EPSILON), 2);
        check_sides(&m, 1e5 * CHECK_EPSILON);
        free_model(&m);
    }
}

static void test_torus_and_hollow_box(void **state) {
    model m;
    check_closed shell;
    (void)state;
    shape_torus(&s0, 24, 12);
    m = cut_model(slices(&s0, 6), &s0, blade_of(plane_of(1, 0.1, 0, 0.05), NULL, 0), NULL);
    assert_int_equal(check_pieces(m.skin, m.cut, 1e5 * CHECK_EPSILON), 2);
    check_sides(&m, 1e5 * CHECK_EPSILON);
    free_model(&m);
    m = cut_model(slices(&s0, 6), &s0, blade_of(plane_of(0, 0.1, 1, 0.05), NULL, 0), NULL); /* two rings */
    assert_int_equal(check_pieces(m.skin, m.cut, 1e5 * CHECK_EPSILON), 2);
    check_sides(&m, 1e5 * CHECK_EPSILON);
    free_model(&m);
    shape_hollow_box(&s0, &s1);
    m = cut_model(slices(&s0, 4), &s0, blade_of(plane_of(0, 0, 1, 2.2), NULL, 0), NULL);
    shell = shell_of(m.cut, NULL);
    assert_int_equal(check_pieces(m.skin, m.cut, 1e4 * CHECK_EPSILON), 2);
    check_near(check_closed_area(&shell, m.cut->wall, 1), 12, 1e3 * CHECK_EPSILON); /* 16 less the hole */
    check_sides(&m, 1e5 * CHECK_EPSILON);
    free_model(&m);
    shape_plate(&s0);
    m = cut_model(grid(8, 6, 2, vec3(0, 0, 0), vec3(8, 6, 2)), &s0, blade_of(plane_of(0, 1, 0, 3.1), NULL, 0), NULL);
    shell = shell_of(m.cut, NULL);
    assert_int_equal(check_pieces(m.skin, m.cut, 1e4 * CHECK_EPSILON), 2);
    check_near(check_closed_area(&shell, m.cut->wall, -1), 8, 1e3 * CHECK_EPSILON); /* three bridges */
    free_model(&m);
}

/* Counts what is in use. Sizes are kept in front of the memory. */
typedef struct meter {
    size_t live, peak;
} meter;

static void *metered(void *user, void *pointer, size_t size) {
    meter *m = (meter *)user;
    size_t *block = pointer ? (size_t *)pointer - 8 : NULL;
    if (block) m->live -= block[0];
    if (!size) {
        free(block);
        return NULL;
    }
    block = (size_t *)realloc(block, size + 8 * sizeof *block);
    if (!block) return NULL;
    block[0] = size, m->live += size;
    if (m->live > m->peak) m->peak = m->live;
    return block + 8;
}

/* n * n cubes, none glued to another, each with a skin of its own, cut by one plane: memory is in proportion. */
static size_t peak_of_cubes(int n) {
    dgfem_mesh *mesh = grid(n, n, 1, vec3(0, 0, 0), vec3(n, n, 1));
    dgfemi_blade blade = blade_of(plane_of(0, 0, 1, 0.4), NULL, 0);
    dgfem_vec3 *vertices = (dgfem_vec3 *)malloc((size_t)(8 * n * n) * sizeof *vertices);
    int *triangles = (int *)malloc((size_t)(36 * n * n) * sizeof *triangles), count, *one;
    dgfem_skin_desc desc = dgfem_default_skin_desc();
    dgfem_body *body;
    dgfem_skin *skin, *cut;
    meter m;
    shape_box(&s0, 0.1, 0.1, 0.1, 0.9, 0.9, 0.9);
    one = triangles_of(&s0, &count);
    for (int i = 0; i < 8 * n * n; i++)
        vertices[i] = dgfemi_add(s0.vertices[i % 8], vec3(i / 8 % n, i / 8 / n, 0));
    for (int i = 0; i < 36 * n * n; i++) triangles[i] = one[i % 36] + 8 * (i / 36);
    free(one);
    for (int f = 0; f < mesh->face_count; f++) mesh->faces[f].cut = mesh->faces[f].element[1] != DGFEM_NONE;
    open_mesh(mesh, &blade);
    body = check_body_create(mesh, NULL, 1, NULL);
    memset(&m, 0, sizeof m);
    desc.hooks.reallocate = metered, desc.hooks.reallocate_user = &m;
    desc.vertices = dgfem_points_in_vec3(vertices, 8 * n * n);
    desc.triangles = triangles, desc.triangle_count = 12 * n * n;
    check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_OK);
    m.peak = 0;
    check_status(cut_skin(skin, body, &blade, &cut), DGFEM_OK);
    free(vertices);
    free(triangles);
    dgfem_skin_destroy(skin);
    dgfem_skin_destroy(cut);
    assert_int_equal(m.live, 0);
    check_body_destroy(body);
    return m.peak;
}

static void test_many_pieces(void **state) {
    size_t few = peak_of_cubes(20), many = peak_of_cubes(40);
    (void)state;
    print_message("%.1f and %.1f MB\n", (double)few * 1e-6, (double)many * 1e-6);
    assert_true(many < 5 * few);
}

/* ---- polygons ---- */

/* A slit from one side: one piece, closed; from the open side the walls part. */
static void test_slit(void **state) {
    static const double outlines[][8] = {
        {-1, -1, 2, -1, 2, 0.62, -1, 0.62},     /* straight front through the whole cube */
        {0.3, -1, 0.7, -1, 0.7, 0.4, 0.3, 0.4}, /* with two corners inside */
        {0.3, -1, 0.3, 0.4, 0.7, 0.4, 0.7, -1}, /* clockwise */
        {-0.5, 0.2, 0.5, -0.4, 1.5, 0.2, 0.5, 0.6},
    };
    static const double areas[] = {0.62, 0.16, 0.16, -1};
    (void)state;
    shape_box(&s0, 0, 0, 0, 1, 1, 1);
    for (size_t i = 0; i < sizeof outlines / sizeof *outlines; i++) {
        dgfem_vec3 polygon[4];
        model m;
        check_closed shell;
        for (int k = 0; k < 4; k++) polygon[k] = vec3(outlines[i][2 * k], outlines[i][2 * k + 1], 0.45);
        m = cut_model(grid(4, 4, 4, vec3(0, 0, 0), vec3(1, 1, 1)), &s0, blade_of(plane_of(0, 0, 1, 0.45), polygon, 4),
                      NULL);
        shell = shell_of(m.cut, NULL);
        assert_int_equal(check_pieces(m.skin, m.cut, 1024 * CHECK_EPSILON), 1);
        assert_int_equal(m.cut->cut_count, 1);
        if (areas[i] > 0) check_near(check_closed_area(&shell, m.cut->wall, 1), areas[i], 1024 * CHECK_EPSILON);
        free_model(&m);
    }
}

/* Polygons inside, around and beside the body. */
static void test_whole_polygons(void **state) {
    static const double centres[] = {0.5, 0.5, 5}, sizes[] = {0.3, 3, 1}, areas[] = {0.36, 1, 0};
    (void)state;
    shape_box(&s0, 0, 0, 0, 1, 1, 1);
    for (int i = 0; i < 3; i++) {
        double c = centres[i], r = sizes[i];
        dgfem_vec3 polygon[4];
        model m;
        check_closed shell;
        for (int k = 0; k < 4; k++) polygon[k] = vec3(k == 0 || k == 3 ? c - r : c + r, k < 2 ? c - r : c + r, 0.45);
        m = cut_model(grid(4, 4, 4, vec3(0, 0, 0), vec3(1, 1, 1)), &s0, blade_of(plane_of(0, 0, 1, 0.45), polygon, 4),
                      NULL);
        shell = shell_of(m.cut, NULL);
        assert_int_equal(check_pieces(m.skin, m.cut, 1024 * CHECK_EPSILON), i == 2 ? 1 : 2);
        check_near(check_closed_area(&shell, m.cut->wall, 1), areas[i], 1024 * CHECK_EPSILON);
        free_model(&m);
    }
}

/* Of two cubes' worth of legs only one is cut. */
static void test_star_polygon(void **state) {
    dgfem_vec3 polygon[10];
    model m;
    (void)state;
    make_ball(&s0, 16, 24);
    for (int i = 0; i < 10; i++) {
        double a = 0.1 + 3.14159265358979324 * i / 5, r = i % 2 ? 0.6 : 1.5;
        polygon[i] = vec3(r * cos(a), r * sin(a), 0.07);
    }
    m = cut_model(slices(&s0, 5), &s0, blade_of(plane_of(0, 0, 1, 0.07), polygon, 10), NULL);
    assert_int_equal(check_pieces(m.skin, m.cut, 4096 * CHECK_EPSILON), 1);
    free_model(&m);
}

/* ---- again and again ---- */

/* A body whose mesh has all the cuts; the skin takes them one by one. */
static dgfem_skin *cut_again(dgfem_skin *skin, const dgfem_body *body, const dgfemi_blade *blade) {
    dgfem_skin *next;
    check_status(cut_skin_by(skin, body, blade, 0, &next), DGFEM_OK);
    dgfem_skin_destroy(skin);
    return next;
}

static dgfem_skin *skin_of(const dgfem_body *body, const shape *s, const dgfem_hooks *hooks) {
    dgfem_skin_desc desc = dgfem_default_skin_desc();
    int *triangles = triangles_of(s, &desc.triangle_count);
    dgfem_skin *skin;
    if (hooks) desc.hooks = *hooks;
    desc.vertices = dgfem_points_in_vec3(s->vertices, s->vertex_count), desc.triangles = triangles;
    check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_OK);
    free(triangles);
    return skin;
}

/* Three planes across: eight pieces, also when two of them are repeated; each octant moves on its own. */
static void test_crossing_cuts(void **state) {
    dgfem_mesh *mesh = grid(3, 3, 3, vec3(0, 0, 0), vec3(1, 1, 1));
    dgfem_body *body;
    dgfem_skin *first, *skin;
    dgfemi_blade blades[5];
    (void)state;
    shape_box(&s0, 0, 0, 0, 1, 1, 1);
    blades[0] = blade_of(plane_of(1, 0, 0, 0.5), NULL, 0);
    blades[1] = blade_of(plane_of(0, 1, 0, 0.4), NULL, 0);
    blades[2] = blade_of(plane_of(0, 1, 5, 2.5), NULL, 0);
    blades[3] = blades[1];
    blades[4] = blade_of(plane_of(-1, 0, 0, -0.5), NULL, 0);
    for (int i = 0; i < 3; i++) open_mesh(mesh, &blades[i]);
    body = check_body_create(mesh, NULL, 1, NULL);
    first = skin_of(body, &s0, NULL), skin = skin_of(body, &s0, NULL);
    for (int i = 0; i < 5; i++) {
        skin = cut_again(skin, body, &blades[i]);
        assert_int_equal(check_pieces(first, skin, 4096 * CHECK_EPSILON), i > 2 ? 8 : 1 << (i + 1));
        assert_int_equal(skin->cut_count, i > 2 ? 3 : i + 1);
    }
    for (int pass = 0; pass < 2; pass++) {
        int *piece = (int *)malloc(sizeof(int) * (size_t)skin->triangle_count);
        check_closed shell = shell_of(skin, NULL);
        for (int e = 0; e < mesh->element_count; e++) {
            dgfem_vec3 c = mesh->elements[e].centre;
            double x = dgfemi_blade_side(&blades[0], c), y = dgfemi_blade_side(&blades[1], c),
                   z = dgfemi_blade_side(&blades[2], c);
            body->displacement[body->basis_start[e]] = vec3(x, y, z);
        }
        check_status(dgfem_skin_update(skin, body), DGFEM_OK);
        assert_int_equal(check_closed_pieces(&shell, piece), 8);
        for (int p = 0; p < 8; p++) { /* all vertices of a piece make the same move, by whole numbers */
            int seen = 0;
            dgfem_vec3 u = vec3(0, 0, 0);
            for (int t = 0; t < skin->triangle_count; t++)
                for (int k = 0; piece[t] == p && k < 3; k++) {
                    int v = skin->triangles[3 * t + k];
                    dgfem_vec3 d = dgfemi_sub(skin->positions[v], skin->embedding->points[v]);
                    if (!seen) u = d, seen = 1;
                    check_near3(d, u, 4096 * CHECK_EPSILON);
                    check_near(d.x, floor((double)d.x + 0.5), 4096 * CHECK_EPSILON);
                }
        }
        free(piece);
        memset(body->displacement, 0, sizeof *body->displacement * (size_t)body->basis_count);
        body->revision++; /* the same once more after a renewal */
        check_status(dgfem_skin_renew(skin, body), DGFEM_OK);
        first->embedding->revision++;
        (void)check_pieces(first, skin, 4096 * CHECK_EPSILON);
    }
    dgfem_skin_destroy(first);
    dgfem_skin_destroy(skin);
    check_body_destroy(body);
}

/* A slit that ends at an earlier cut, and one that crosses an earlier slit. */
static void test_slits_meet(void **state) {
    static const double second[2][4] = {{0.1, 0.45, 0.9, 0.9}, {0.3, -1, 0.7, 2}}; /* x and z of a rectangle */
    (void)state;
    shape_box(&s0, 0, 0, 0, 1, 1, 1);
    for (int i = 0; i < 2; i++) {
        dgfem_mesh *mesh = grid(4, 4, 4, vec3(0, 0, 0), vec3(1, 1, 1));
        dgfem_vec3 a[4], b[4];
        dgfemi_blade blades[2];
        dgfem_body *body;
        dgfem_skin *first, *skin;
        const double *r = second[i];
        for (int k = 0; k < 4; k++) {
            a[k] = vec3(k == 0 || k == 3 ? -1 : 0.8, k < 2 ? -1 : 2, 0.45);
            b[k] = vec3(k == 0 || k == 3 ? r[0] : r[2], 0.35, k < 2 ? r[1] : r[3]);
        }
        blades[0] = blade_of(plane_of(0, 0, 1, 0.45), a, 4), blades[1] = blade_of(plane_of(0, 1, 0, 0.35), b, 4);
        for (int k = 0; k < 2; k++) open_mesh(mesh, &blades[k]);
        body = check_body_create(mesh, NULL, 1, NULL);
        first = skin_of(body, &s0, NULL), skin = skin_of(body, &s0, NULL);
        for (int k = 0; k < 2; k++) {
            skin = cut_again(skin, body, &blades[k]);
            assert_int_equal(check_pieces(first, skin, 4096 * CHECK_EPSILON), 1);
            assert_int_equal(skin->cut_count, k + 1);
        }
        dgfem_skin_destroy(first);
        dgfem_skin_destroy(skin);
        check_body_destroy(body);
    }
}

/* Random planes and polygons, some through vertices, on one cube after the other: always closed, volume kept. */
static void test_random_cuts(void **state) {
    check_random random = check_random_seeded(51);
    (void)state;
    make_ball(&s0, 8, 10);
    for (int i = 0; i < (check_long() ? 300 : 12); i++) {
        dgfem_mesh *mesh = grid(2, 2, 2, vec3(-1, -1, -1), vec3(1, 1, 1));
        dgfem_vec3 polygons[4][5];
        dgfemi_blade blades[4];
        dgfem_body *body;
        dgfem_skin *first, *skin;
        for (int k = 0; k < 4; k++) {
            dgfem_vec3 normal = dgfemi_normalized(check_random_vec3(&random, -1, 1)), x, u, w;
            double turn = check_random_real(&random, 0, 6);
            x = check_random_vec3(&random, -0.4, 0.4);
            if (i % 3 == 0) x = s0.vertices[check_random_int(&random, s0.vertex_count)];
            if (i % 3 == 1) normal = vec3(k == 0, k == 1, k > 1), x = vec3(0, 0, 0);
            u = dgfemi_normalized(dgfemi_cross(normal, vec3(0.3, 0.5, 0.7))), w = dgfemi_cross(normal, u);
            for (int c = 0; c < 5; c++) {
                double angle = turn + 6.283185307179586 * c / 5, radius = check_random_real(&random, 0.3, 1.2);
                polygons[k][c] = dgfemi_add_scaled(dgfemi_add_scaled(x, (dgfem_real)(radius * cos(angle)), u),
                                                   (dgfem_real)(radius * sin(angle)), w);
            }
            blades[k].normal = normal, blades[k].offset = dgfemi_dot(normal, x);
            blades[k].polygon = k % 2 ? polygons[k] : NULL, blades[k].polygon_count = k % 2 ? 5 : 0;
            open_mesh(mesh, &blades[k]);
        }
        body = check_body_create(mesh, NULL, 1, NULL);
        first = skin_of(body, &s0, NULL), skin = skin_of(body, &s0, NULL);
        for (int k = 0; k < 4; k++) {
            skin = cut_again(skin, body, &blades[k]);
            assert_true(check_pieces(first, skin, 1e5 * CHECK_EPSILON) >= 1);
        }
        dgfem_skin_destroy(first);
        dgfem_skin_destroy(skin);
        check_body_destroy(body);
    }
}

/* ---- bodies that have moved, seams, borders ---- */

/* The blade is in the world: a body that has turned, sheared and moved is cut where it is now. */
static void test_moved_body(void **state) {
    check_random random = check_random_seeded(52);
    (void)state;
    make_ball(&s0, 12, 16);
    for (int i = 0; i < 4; i++) {
        check_affine affine = check_random_affine(&random);
        dgfem_vec3 polygon[3];
        dgfemi_blade world, rest;
        dgfem_mesh *mesh = grid(3, 3, 3, vec3(-1, -1, -1), vec3(1, 1, 1));
        dgfem_body *body;
        dgfem_skin *skin, *cut;
        dgfem_mat3 f, ft;
        check_closed shell;
        int *identity;
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) affine.linear.m[r][c] *= DGFEM_R(0.4);
        f = affine.linear, f.m[0][0] += 1, f.m[1][1] += 1, f.m[2][2] += 1;
        ft = dgfemi_transposed(&f);
        rest = blade_of(plane_of(0.2, -0.3, 1, 0.15), NULL, 0); /* n.x = o there, F^-T n.X = o + F^-T n.a here */
        polygon[0] = vec3(-2, -2, 0), polygon[1] = vec3(0.5, -2, 0), polygon[2] = vec3(0.2, 2, 0);
        for (int k = 0; k < 3; k++)
            polygon[k] = dgfemi_add_scaled(polygon[k], -dgfemi_blade_distance(&rest, polygon[k]), rest.normal);
        if (i % 2) rest.polygon = polygon, rest.polygon_count = 3;
        open_mesh(mesh, &rest);
        body = check_body_create(mesh, NULL, 1, NULL);
        skin = skin_of(body, &s0, NULL);
        check_set_affine(body, body->displacement, &affine);
        check_status(dgfem_skin_update(skin, body), DGFEM_OK);
        for (int k = 0; k < 3; k++) polygon[k] = dgfemi_add(polygon[k], check_affine_at(&affine, polygon[k]));
        world = rest;
        {
            dgfem_vec3 c0 = dgfemi_column(&ft, 0), c1 = dgfemi_column(&ft, 1), c2 = dgfemi_column(&ft, 2),
                       n = rest.normal;
            dgfem_vec3 m =
                vec3((double)dgfemi_dot(n, dgfemi_cross(c1, c2)), (double)dgfemi_dot(c0, dgfemi_cross(n, c2)),
                     (double)dgfemi_dot(c0, dgfemi_cross(c1, n)));
            world.normal = dgfemi_normalized(m);
            if (dgfemi_determinant(&ft) < 0) world.normal = dgfemi_scale(-1, world.normal);
            m = dgfemi_scale(rest.offset, rest.normal); /* a point of the plane */
            world.offset = dgfemi_dot(world.normal, dgfemi_add(m, check_affine_at(&affine, m)));
        }
        check_status(cut_skin(skin, body, &world, &cut), DGFEM_OK);
        identity = (int *)malloc(sizeof(int) * (size_t)skin->vertex_count);
        for (int v = 0; v < skin->vertex_count; v++) identity[v] = v;
        assert_int_equal(check_pieces(skin, cut, 1e4 * CHECK_EPSILON), i % 2 ? 1 : 2);
        assert_int_equal(cut->cut_count, 1);
        shell = shell_of(cut, identity);
        free(identity);
        for (int v = 0; v < cut->vertex_count; v++) {
            dgfem_vec3 x = cut->embedding->points[v];
            check_near3(cut->positions[v], dgfemi_add(x, check_affine_at(&affine, x)), 1e4 * CHECK_EPSILON);
        }
        for (int t = 0; t < cut->triangle_count; t++)
            for (int k = 0; cut->wall[t] && k < 3; k++)
                check_near(dgfemi_blade_distance(&world, cut->positions[cut->triangles[3 * t + k]]), 0,
                           1e4 * CHECK_EPSILON);
        check_near(check_closed_area(&shell, cut->wall, 1) > 0.1, 1, 0);
        dgfem_skin_destroy(skin);
        dgfem_skin_destroy(cut);
        check_body_destroy(body);
    }
}

/* A cube whose sides have vertices of their own, as for texture coordinates: welded by position, cut as one. */
static void test_seams(void **state) {
    dgfem_vec3 vertices[36];
    int triangles[36], count, *welded;
    dgfem_skin_desc desc = dgfem_default_skin_desc();
    dgfem_mesh *mesh = grid(2, 2, 2, vec3(0, 0, 0), vec3(1, 1, 1));
    dgfemi_blade blade = blade_of(plane_of(1, 2, 3, 2.5), NULL, 0);
    dgfem_body *body;
    dgfem_skin *skin, *cut;
    check_closed shell;
    int *piece;
    (void)state;
    shape_box(&s0, 0, 0, 0, 1, 1, 1);
    welded = triangles_of(&s0, &count);
    assert_int_equal(count, 12);
    for (int i = 0; i < 36; i++) vertices[i] = s0.vertices[welded[i]], triangles[i] = i;
    free(welded);
    open_mesh(mesh, &blade);
    body = check_body_create(mesh, NULL, 1, NULL);
    desc.vertices = dgfem_points_in_vec3(vertices, 36), desc.triangles = triangles, desc.triangle_count = 12;
    check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_OK);
    check_status(cut_skin(skin, body, &blade, &cut), DGFEM_OK);
    shell = shell_of(cut, NULL);
    piece = (int *)malloc(sizeof(int) * (size_t)cut->triangle_count);
    assert_int_equal(check_closed_open_edges(&shell), 0);
    assert_int_equal(check_closed_pieces(&shell, piece), 2);
    check_near(check_closed_volume(&shell, NULL, 0), 1, 256 * CHECK_EPSILON);
    for (int t = 0; t < 12; t++) /* no vertex is shared between triangles of different sources */
        for (int u = 0; u < cut->triangle_count; u++)
            for (int k = 0; k < 9 && cut->source[u] != cut->source[t]; k++)
                assert_int_not_equal(cut->triangles[3 * t + k % 3], cut->triangles[3 * u + k / 3]);
    free(piece);
    dgfem_skin_destroy(skin);
    dgfem_skin_destroy(cut);
    check_body_destroy(body);
}

/* A surface with a border gets no walls where its section does not close; points alone are renewed. */
static void test_open_skins(void **state) {
    static const int sheet[6] = {0, 1, 2, 0, 2, 3};
    dgfem_vec3 vertices[4];
    dgfem_mesh *mesh = grid(2, 2, 2, vec3(0, 0, 0), vec3(1, 1, 1));
    dgfemi_blade blade = blade_of(plane_of(1, 0.1, 0, 0.5), NULL, 0);
    dgfem_body *body;
    (void)state;
    vertices[0] = vec3(0, 0.1, 0.3), vertices[1] = vec3(1, 0.1, 0.3);
    vertices[2] = vec3(1, 0.9, 0.3), vertices[3] = vec3(0, 0.9, 0.3);
    open_mesh(mesh, &blade);
    body = check_body_create(mesh, NULL, 1, NULL);
    for (int pass = 0; pass < 3; pass++) {
        dgfem_skin_desc desc = dgfem_default_skin_desc();
        dgfem_skin *skin, *cut;
        desc.vertices = dgfem_points_in_vec3(vertices, pass == 2 ? 0 : 4);
        if (pass == 0) desc.triangles = sheet, desc.triangle_count = 2;
        check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_OK);
        check_status(cut_skin(skin, body, &blade, &cut), DGFEM_OK);
        if (pass == 0) {
            check_closed shell = shell_of(cut, NULL);
            int piece[32];
            assert_int_equal(cut->triangle_count, 6);
            assert_int_equal(cut->vertex_count, 4 + 6);
            assert_int_equal(check_closed_pieces(&shell, piece), 2);
            for (int t = 0; t < 6; t++) assert_int_equal(cut->wall[t], 0);
        } else {
            assert_int_equal(cut->vertex_count, skin->vertex_count);
            assert_null(cut->triangles);
        }
        for (int e = 0; e < mesh->element_count; e++)
            body->displacement[body->basis_start[e]].x =
                (dgfem_real)dgfemi_blade_side(&blade, mesh->elements[e].centre);
        check_status(dgfem_skin_update(cut, body), DGFEM_OK);
        for (int v = 0; v < cut->vertex_count; v++) {
            double u = (double)cut->positions[v].x - (double)cut->embedding->points[v].x;
            check_near(u, floor(u + 0.5), 256 * CHECK_EPSILON);
            if (v < 4) check_near(u, v == 1 || v == 2, 256 * CHECK_EPSILON);
        }
        memset(body->displacement, 0, sizeof *body->displacement * (size_t)body->basis_count);
        dgfem_skin_destroy(skin);
        dgfem_skin_destroy(cut);
    }
    check_body_destroy(body);
}

/* Weights that are kept through a cut are those that would be made anew. */
static void test_kept_weights(void **state) {
    check_random random = check_random_seeded(53);
    dgfemi_blade blade = blade_of(plane_of(1, 0.2, 0.1, 0.31), NULL, 0);
    dgfem_mesh *meshes[2];
    dgfem_body *bodies[2];
    dgfem_skin *skins[2], *cuts[2];
    (void)state;
    make_ball(&s0, 16, 24);
    for (int i = 0; i < 2; i++) meshes[i] = grid(10, 7, 7, vec3(-1, -1, -1), vec3(1, 1, 1));
    open_mesh(meshes[1], &blade);
    for (int i = 0; i < 2; i++) bodies[i] = check_body_create(meshes[i], NULL, 2, NULL);
    for (int i = 0; i < 2; i++) skins[i] = skin_of(bodies[0], &s0, NULL);
    for (int e = 0; e < meshes[0]->element_count; e++)
        skins[1]->embedding->element_glue[e] += 100; /* all has changed */
    for (int i = 0; i < 2; i++)
        check_status(cut_skin(skins[i], bodies[1], &blade, &cuts[i]), DGFEM_OK);
    assert_int_equal(cuts[0]->vertex_count, cuts[1]->vertex_count);
    for (int i = 0; i < bodies[1]->basis_count; i++) bodies[1]->displacement[i] = check_random_vec3(&random, -1, 1);
    for (int i = 0; i < 2; i++) check_status(dgfem_skin_update(cuts[i], bodies[1]), DGFEM_OK);
    for (int v = 0; v < cuts[0]->vertex_count; v++) {
        check_near3(cuts[0]->positions[v], cuts[1]->positions[v], 1e5 * CHECK_EPSILON);
    }
    for (int i = 0; i < 2; i++) {
        dgfem_skin_destroy(skins[i]);
        dgfem_skin_destroy(cuts[i]);
        check_body_destroy(bodies[i]);
    }
}

/* Weights sum to one, keep places (sum of weight * sample = point), and join nothing that is cut apart. */
static void check_weights(const dgfem_body *body, const dgfem_embedding *embedding, double tolerance) {
    int *piece = (int *)malloc(sizeof(int) * (size_t)body->mesh->element_count), count;
    check_status(dgfem_body_pieces(body, piece, NULL, 0, &count), DGFEM_OK);
    for (int p = 0; p < embedding->point_count; p++) {
        double sum = 0;
        dgfem_vec3 x = vec3(0, 0, 0);
        int home = piece[embedding->point_element[p]];
        for (int i = embedding->weight_start[p]; i < embedding->weight_start[p + 1]; i++) {
            int s = embedding->weight_sample[i];
            sum += (double)embedding->weight[i];
            x = dgfemi_add_scaled(x, embedding->weight[i], embedding->samples[s]);
            assert_true(i == embedding->weight_start[p] || s > embedding->weight_sample[i - 1]);
            for (int t = embedding->term_start[s]; t < embedding->term_start[s + 1]; t++)
                assert_int_equal(piece[embedding->term_element[t]], home);
        }
        check_near(sum, 1, tolerance);
        check_near3(x, embedding->points[p], tolerance);
    }
    free(piece);
}

/* Points whose weights are the same bits as before. */
static int count_kept(const dgfem_embedding *before, const dgfem_embedding *after) {
    int kept = 0;
    for (int p = 0; p < before->point_count; p++) {
        int a = before->weight_start[p], b = after->weight_start[p], n = before->weight_start[p + 1] - a;
        if (after->weight_start[p + 1] - b != n) continue;
        kept += memcmp(before->weight + a, after->weight + b, sizeof *after->weight * (size_t)n) == 0;
    }
    return kept;
}

/* Of the corners at x; 0: there is none. */
static dgfem_real largest_window(const dgfem_embedding *embedding, dgfem_vec3 x) {
    dgfem_real largest = 0;
    for (int s = embedding->element_count; s < embedding->sample_count; s++)
        if (dgfemi_same_position(embedding->samples[s], x)) largest = dgfemi_max(largest, embedding->sample_radius[s]);
    return largest;
}

/* Cut after cut of a living body, by planes and slits: what is kept is as good as what is new. Samples keep the windows
   that they had, which may only grow, so weights depend on what was before; what must hold of weights always holds. */
static void test_history(void **state) {
    dgfem_mesh *mesh;
    dgfem_body_desc desc = dgfem_default_body_desc();
    dgfem_cut_desc cut = dgfem_default_cut_desc();
    dgfem_body *body;
    dgfem_skin *skin;
    dgfem_vec3 polygon[4];
    dgfem_real *areas;
    double tolerance = DGFEM_REAL_IS_FLOAT ? 3e-5 : 1e-13;
    int original;
    (void)state;
    make_ball(&s0, 16, 24);
    mesh = slices(&s0, 9);
    desc.mesh = mesh;
    check_status(dgfem_body_create(&desc, &body), DGFEM_OK);
    skin = skin_of(body, &s0, NULL), original = skin->vertex_count;
    areas = (dgfem_real *)malloc(sizeof *areas * (size_t)original);
    for (int v = 0; v < original; v++) areas[v] = DGFEM_R(0.01);
    check_status(dgfem_body_set_contact_points(body, dgfem_points_in_vec3(s0.vertices, original), areas), DGFEM_OK);
    polygon[0] = vec3(-2, 0.1, -2), polygon[1] = vec3(0.3, 0.13, -2), polygon[2] = vec3(0.3, 0.13, 2);
    polygon[3] = vec3(-2, 0.1, 2);
    cut.skins = &skin, cut.skin_count = 1;
    for (int i = 0; i < 7; i++) {
        static const double planes[6][4] = {{1, 0.02, 0, 0.83}, {1, 0.1, 0.1, 0.4},  {0, 0.1, 1, -0.75},
                                            {0, 0, 1, 0.93},    {0.1, 1, 0.2, -0.6}, {1, 1, 1, 0.1}};
        const dgfem_embedding *e = skin->embedding;
        dgfem_embedding before = *e;
        size_t samples = (size_t)e->sample_count, points = (size_t)e->point_count;
        dgfem_plane plane = plane_of(planes[i % 6][0], planes[i % 6][1], planes[i % 6][2], planes[i % 6][3]);
        int kept;
        before.weight_start = (int *)dgfemi_duplicate(&e->hooks, e->weight_start, points + 1, sizeof(int));
        before.weight =
            (dgfem_real *)dgfemi_duplicate(&e->hooks, e->weight, (size_t)e->weight_start[points], sizeof(dgfem_real));
        before.samples = (dgfem_vec3 *)dgfemi_duplicate(&e->hooks, e->samples, samples, sizeof(dgfem_vec3));
        before.sample_radius = (dgfem_real *)dgfemi_duplicate(&e->hooks, e->sample_radius, samples, sizeof(dgfem_real));
        if (i == 6) check_status(dgfem_body_cut_polygon(body, dgfem_points_in_vec3(polygon, 4), &cut, NULL), DGFEM_OK);
        else check_status(dgfem_body_cut_plane(body, plane, &cut, NULL), DGFEM_OK);
        e = skin->embedding;
        check_weights(body, e, tolerance);
        check_weights(body, body->contacts->embedding, tolerance);
        assert_int_equal(body->contacts->embedding->point_count, original);
        kept = count_kept(&before, e);
        print_message("cut %d: %d of %d points keep their weights\n", i, kept, before.point_count);
        if (i == 0) assert_true(3 * kept > before.point_count && kept < before.point_count);
        for (int k = before.element_count; i < 6 && k < before.sample_count; k++) {
            dgfem_vec3 x = before.samples[k];
            dgfem_real now = largest_window(e, x);
            if (dgfemi_abs(dgfemi_dot(plane.normal, x) - plane.offset) < DGFEM_R(0.7)) continue;
            if (now > 0) assert_true(now >= largest_window(&before, x));
        }
        free(before.weight_start);
        free(before.weight);
        free(before.samples);
        free(before.sample_radius);
    }
    {
        dgfem_embedding before = *skin->embedding; /* nothing has changed: nothing changes */
        size_t count = (size_t)before.weight_start[before.point_count];
        dgfem_real *weight = (dgfem_real *)dgfemi_duplicate(&before.hooks, before.weight, count, sizeof *weight);
        check_status(dgfem_skin_renew(skin, body), DGFEM_OK);
        assert_int_equal(skin->embedding->weight_start[skin->embedding->point_count], count);
        assert_memory_equal(skin->embedding->weight, weight, count * sizeof *weight);
        free(weight);
    }
    free(areas);
    dgfem_skin_destroy(skin);
    dgfem_body_destroy(body);
}

/* Large walls have points inside, so that they can bend; small ones do not. */
static void test_walls_bend(void **state) {
    (void)state;
    shape_box(&s0, 0, 0, 0, 1, 1, 1);
    for (int n = 1; n <= 9; n += 8) {
        model m = cut_model(grid(n, n, n, vec3(0, 0, 0), vec3(1, 1, 1)), &s0,
                            blade_of(plane_of(0, 0, 1, 0.45), NULL, 0), NULL);
        int inside = 0;
        for (int v = m.skin->vertex_count; v < m.cut->vertex_count; v++) {
            dgfem_vec3 x = m.cut->embedding->points[v];
            inside += x.x > DGFEM_R(0.01) && x.x < DGFEM_R(0.99) && x.y > DGFEM_R(0.01) && x.y < DGFEM_R(0.99);
        }
        if (n == 1) assert_int_equal(inside, 0);
        else assert_true(inside >= 2);
        free_model(&m);
    }
}

/* The same skin with vertices of its own for each triangle. */
static dgfem_skin *soup_of(const dgfem_body *body, const shape *s) {
    dgfem_skin_desc desc = dgfem_default_skin_desc();
    int *triangles = triangles_of(s, &desc.triangle_count), count = 3 * desc.triangle_count;
    dgfem_vec3 *vertices = (dgfem_vec3 *)malloc((size_t)count * sizeof *vertices);
    dgfem_skin *skin;
    for (int i = 0; i < count; i++) vertices[i] = s->vertices[triangles[i]], triangles[i] = i;
    desc.vertices = dgfem_points_in_vec3(vertices, count), desc.triangles = triangles;
    check_status(dgfem_skin_create(body, &desc, &skin), DGFEM_OK);
    free(vertices);
    free(triangles);
    return skin;
}

/* A weld is named by its lowest vertex; its vertices are in one place and in one piece of the body. Returns the number
   of welds. */
static int check_welds(const dgfem_skin *skin, const int *piece_of) {
    const dgfem_embedding *e = skin->embedding;
    int count = 0;
    for (int v = 0; v < skin->vertex_count; v++) {
        int weld = skin->weld[v];
        assert_true(weld <= v && skin->weld[weld] == weld);
        assert_true(dgfemi_same_position(e->points[v], e->points[weld]));
        assert_int_equal(piece_of[e->point_element[v]], piece_of[e->point_element[weld]]);
        count += weld == v;
    }
    return count;
}

/* A knife that goes down through a falling body in steps, three times: the body moves between the parts of a stroke, so
   that their slits do not quite meet. Still no triangle may hang between elements of different pieces, and the skin does
   not grow out of bounds. */
static void test_strokes_in_motion(void **state) {
    static const int triangles[] = {0, 2, 1, 1, 2, 3};
    dgfem_mesh *mesh = grid(3, 3, 3, vec3(-1, -1, -1), vec3(1, 1, 1));
    dgfem_body_desc body_desc = dgfem_default_body_desc();
    dgfem_body *body;
    dgfem_cut_desc desc = dgfem_default_cut_desc();
    dgfem_skin *skins[2], *skin;
    int *piece_of, count, before;
    (void)state;
    body_desc.mesh = mesh, body_desc.material.young = 10000;
    check_status(dgfem_body_create(&body_desc, &body), DGFEM_OK);
    make_ball(&s0, 16, 24);
    skin = skins[0] = skin_of(body, &s0, NULL), skins[1] = soup_of(body, &s0);
    before = skin->vertex_count;
    desc.skins = skins, desc.skin_count = 2, desc.smallest = (dgfem_real)0.05;
    for (int stroke = 0; stroke < 3; stroke++) {
        double a = 0.9 * stroke + 0.2, off = 0.15 * stroke - 0.3;
        for (int part = 0; part < 5; part++) {
            double corners[12];
            for (int k = 0; k < 4; k++) {
                double along = k % 2 ? 2 : -2, down = 1.3 - 0.65 * (part + (k < 2 ? -0.1 : 1));
                corners[3 * k] = along * cos(a) - off * sin(a), corners[3 * k + 1] = along * sin(a) + off * cos(a);
                corners[3 * k + 2] = down + (double)body->displacement[0].z;
            }
            check_status(dgfem_body_cut_surface(body, dgfem_points_in_double(corners, 4), triangles, 2, &desc, NULL),
                         DGFEM_OK);
            check_status(dgfem_body_step(body, (dgfem_real)0.03, NULL), DGFEM_OK);
            for (int k = 0; k < 2; k++) check_status(dgfem_skin_update(skins[k], body), DGFEM_OK);
        }
    }
    piece_of = (int *)malloc(sizeof(int) * (size_t)body->mesh->element_count);
    check_status(dgfem_body_pieces(body, piece_of, NULL, 0, &count), DGFEM_OK);
    assert_true(count >= 3);
    for (int i = 0; i < 3 * skin->triangle_count; i++)
        assert_int_equal(piece_of[skin->embedding->point_element[skin->triangles[i]]],
                         piece_of[skin->embedding->point_element[skin->triangles[i - i % 3]]]);
    print_message("%d vertices of %d, %d pieces, %d and %d welds\n", skin->vertex_count, before, count,
                  check_welds(skins[0], piece_of), check_welds(skins[1], piece_of));
    assert_true(skin->vertex_count < 20 * before);
    free(piece_of);
    for (int k = 0; k < 2; k++) dgfem_skin_destroy(skins[k]);
    dgfem_body_destroy(body);
}

static dgfem_refine_action choose_every_other(void *user, const dgfem_body *body, int element,
                                              dgfem_refine_action proposed) {
    (void)user, (void)body, (void)proposed;
    return element % 2 ? DGFEM_REFINE_NONE : DGFEM_REFINE_TWO;
}

/* Triangles between elements of different pieces. */
static int count_torn(const dgfem_skin *skin, const dgfem_body *body) {
    int *piece_of = (int *)malloc(sizeof(int) * (size_t)body->mesh->element_count), count, torn = 0;
    const int *element = skin->embedding->point_element;
    check_status(dgfem_body_pieces(body, piece_of, NULL, 0, &count), DGFEM_OK);
    for (int t = 0; t < skin->triangle_count; t++) {
        const int *v = skin->triangles + 3 * t;
        int a = piece_of[element[v[0]]], b = piece_of[element[v[1]]], c = piece_of[element[v[2]]];
        torn += a != b || b != c;
    }
    free(piece_of);
    return torn;
}

/* After a body in motion has been cut and its small parts, which are not convex then, have been merged, every vertex
   still finds its own side when elements are split again: those at a cut have anchors inside their elements. */
static void test_anchors_are_inside(void **state) {
    check_random random = check_random_seeded(60);
    (void)state;
    make_ball(&s0, 10, 14);
    for (int i = 0; i < (check_long() ? 100 : 2); i++) {
        dgfem_body_desc body_desc = dgfem_default_body_desc();
        dgfem_cut_desc desc = dgfem_default_cut_desc();
        dgfem_refine_desc refine = dgfem_default_refine_desc();
        dgfem_body *body;
        dgfem_skin *skin;
        body_desc.mesh = slices(&s0, 3), body_desc.material.young = 20000;
        check_status(dgfem_body_create(&body_desc, &body), DGFEM_OK);
        for (int k = 0; k < body->basis_count; k++) body->velocity[k] = check_random_vec3(&random, -0.3, 0.3);
        skin = skin_of(body, &s0, NULL);
        desc.skins = &skin, desc.skin_count = 1;
        refine.choose = choose_every_other;
        for (int k = 0; k < 4; k++) {
            dgfem_plane plane;
            plane.normal = dgfemi_normalized(check_random_vec3(&random, -1, 1));
            plane.offset = (dgfem_real)check_random_real(&random, -0.4, 0.4);
            check_status(dgfem_body_cut_plane(body, plane, &desc, NULL), DGFEM_OK);
            assert_int_equal(count_torn(skin, body), 0);
            check_status(dgfem_body_step(body, (dgfem_real)0.02, NULL), DGFEM_OK);
            check_status(dgfem_skin_update(skin, body), DGFEM_OK);
        }
        for (int k = 0; k < 2; k++) {
            check_status(dgfem_body_refine(body, &refine, NULL), DGFEM_OK);
            check_status(dgfem_skin_renew(skin, body), DGFEM_OK);
            assert_int_equal(count_torn(skin, body), 0);
        }
        dgfem_skin_destroy(skin);
        dgfem_body_destroy(body);
    }
}

/* ---- failures ---- */

static dgfem_status cut_and_renew(void *context, const dgfem_hooks *hooks) {
    model *m = (model *)context;
    dgfem_hooks skin_hooks = m->skin->hooks, mesh_hooks = m->body->mesh->hooks;
    dgfem_skin *cut = NULL, *copy;
    dgfem_status status;
    m->skin->hooks = m->body->mesh->hooks = *hooks;
    status = cut_skin(m->skin, m->body, &m->blade, &cut);
    assert_true((status == DGFEM_OK) == (cut != NULL));
    if (cut) {
        dgfem_embedding *before = cut->embedding;
        copy = cut;
        status = dgfem_skin_renew(copy, m->body);
        assert_true(status == DGFEM_OK || copy->embedding == before);
        check_status(dgfem_skin_update(cut, m->body), DGFEM_OK);
    }
    dgfem_skin_destroy(cut);
    m->skin->hooks = skin_hooks, m->body->mesh->hooks = mesh_hooks;
    return status;
}

static void test_failures(void **state) {
    dgfem_vec3 polygon[4];
    model m;
    (void)state;
    polygon[0] = vec3(0.1, -1, 0.45), polygon[1] = vec3(0.9, -1, 0.45), polygon[2] = vec3(0.9, 0.6, 0.45);
    polygon[3] = vec3(0.1, 0.6, 0.45);
    shape_box(&s0, 0, 0, 0, 1, 1, 1);
    m = cut_model(grid(4, 2, 2, vec3(0, 0, 0), vec3(1, 1, 1)), &s0, blade_of(plane_of(0, 0, 1, 0.45), polygon, 4),
                  NULL);
    print_message("%ld allocations\n", check_every_allocation(cut_and_renew, &m));
    check_status(dgfem_skin_renew(NULL, m.body), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_skin_renew(m.cut, NULL), DGFEM_ERROR_ARGUMENT);
    free_model(&m);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cube),         cmocka_unit_test(test_misses),
        cmocka_unit_test(test_ball),         cmocka_unit_test(test_torus_and_hollow_box),
        cmocka_unit_test(test_many_pieces),
        cmocka_unit_test(test_slit),         cmocka_unit_test(test_whole_polygons),
        cmocka_unit_test(test_star_polygon), cmocka_unit_test(test_crossing_cuts),
        cmocka_unit_test(test_slits_meet),   cmocka_unit_test(test_random_cuts),
        cmocka_unit_test(test_moved_body),   cmocka_unit_test(test_seams),
        cmocka_unit_test(test_open_skins),   cmocka_unit_test(test_kept_weights),
        cmocka_unit_test(test_history),      cmocka_unit_test(test_walls_bend),
        cmocka_unit_test(test_strokes_in_motion), cmocka_unit_test(test_anchors_are_inside),
        cmocka_unit_test(test_failures),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
