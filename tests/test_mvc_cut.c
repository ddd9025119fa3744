/* Bodies of polyhedra that are split, cut by planes, polygons and surfaces, and freed of slivers. */
#define DGFEM_IMPLEMENTATION
#include "dgfem_mvc.h"
#include "check_mvc.h"

static const double pi = 3.14159265358979323846;

static dgfem_plane plane_at(double x, double y, double z, double offset) { return convex_mesh_plane(x, y, z, offset); }

static dgfem_mvc *box_of(int nx, int ny, int nz) {
    dgfem_mvc_desc desc = mvc_desc();
    return mvc_of(&desc, mvc_grid(nx, ny, nz, 1, 1, 1));
}

/* At rest, without removing slivers. */
static dgfem_mvc_cut_desc plain_cut(void) {
    dgfem_mvc_cut_desc desc = dgfem_default_mvc_cut_desc();
    desc.current = 0;
    desc.remove_slivers = 0;
    return desc;
}

static dgfem_points_in points_of(const dgfem_vec3 *points, int count) { return dgfem_points_in_vec3(points, count); }

/* A rectangle in the plane z. */
static void rectangle(dgfem_vec3 *p, double x0, double x1, double y0, double y1, double z) {
    p[0] = vec3(x0, y0, z), p[1] = vec3(x1, y0, z), p[2] = vec3(x1, y1, z), p[3] = vec3(x0, y1, z);
}

static dgfem_mvc_cut_info cut_rectangle(dgfem_mvc *body, double x0, double x1, double y0, double y1, double z) {
    dgfem_mvc_cut_desc desc = plain_cut();
    dgfem_mvc_cut_info info;
    dgfem_vec3 p[4];
    rectangle(p, x0, x1, y0, y1, z);
    check_status(dgfem_mvc_cut_polygon(body, points_of(p, 4), &desc, &info), DGFEM_OK);
    return info;
}

static dgfem_mvc_cut_info split(dgfem_mvc *body, dgfem_plane plane) {
    dgfem_mvc_cut_desc desc = plain_cut();
    dgfem_mvc_cut_info info;
    check_status(dgfem_mvc_split_plane(body, plane, &desc, &info), DGFEM_OK);
    return info;
}

static dgfem_mvc_cut_info cut(dgfem_mvc *body, dgfem_plane plane) {
    dgfem_mvc_cut_desc desc = plain_cut();
    dgfem_mvc_cut_info info;
    check_status(dgfem_mvc_cut_plane(body, plane, &desc, &info), DGFEM_OK);
    return info;
}

static int element_size(const dgfem_mvc *body, int e) { return dgfem_mvc_element_nodes(body, e, NULL, 0); }

/* Volume and mass, and first moment of the lumped masses. */
static void check_sums(const dgfem_mvc *body, double volume, dgfem_vec3 moment, double tolerance) {
    double sum[4] = {0, 0, 0, 0}, elements = 0;
    for (int i = 0; i < body->node_count; i++) {
        sum[0] += (double)body->mass[i];
        sum[1] += (double)(body->mass[i] * body->rest[i].x);
        sum[2] += (double)(body->mass[i] * body->rest[i].y);
        sum[3] += (double)(body->mass[i] * body->rest[i].z);
        assert_true(body->mass[i] > 0);
    }
    for (int e = 0; e < body->element_count; e++) elements += (double)body->volume[e];
    check_near(elements, volume, tolerance);
    check_near(sum[0], volume, tolerance);
    check_near3(vec3(sum[1], sum[2], sum[3]), moment, tolerance);
}

/* A body of the unit cube with these numbers of nodes and elements. */
static void check_counts(const dgfem_mvc *body, int nodes, int elements) {
    check_status(dgfem_mvc_check(body), DGFEM_OK);
    assert_int_equal(body->node_count, nodes);
    assert_int_equal(body->element_count, elements);
    check_sums(body, 1, vec3(0.5, 0.5, 0.5), 100 * CHECK_EPSILON);
}

/* ---- the table of node and element counts ---- */

static void test_splits_have_known_counts(void **state) {
    (void)state;
    dgfem_mvc *body = box_of(1, 1, 1);
    assert_int_equal(split(body, plane_at(1, 1, 1, 1.5)).elements_split, 1);
    check_counts(body, 14, 2);
    assert_int_equal(element_size(body, 0), 10);
    assert_int_equal(element_size(body, 1), 10);
    dgfem_mvc_destroy(body);

    body = box_of(1, 1, 1);
    assert_int_equal(split(body, plane_at(1, 1, 1, 1)).nodes_added, 0);
    check_counts(body, 8, 2);
    assert_int_equal(element_size(body, 0) * element_size(body, 1), 28);
    assert_int_equal(element_size(body, 0) + element_size(body, 1), 11);
    dgfem_mvc_destroy(body);

    /* one element is split across: its neighbour gains two hanging nodes, */
    dgfem_mvc_cut_desc desc = plain_cut();
    body = box_of(2, 1, 1);
    check_status(dgfem_mvc_split_element(body, 0, plane_at(0, 0, 1, 0.5), &desc, NULL), DGFEM_OK);
    check_counts(body, 16, 3);
    assert_int_equal(element_size(body, 1), 10);
    dgfem_mvc_destroy(body);

    /* and one that has only an edge in common gains one */
    body = box_of(2, 2, 1);
    check_status(dgfem_mvc_split_element(body, 0, plane_at(0, 0, 1, 0.5), &desc, NULL), DGFEM_OK);
    check_counts(body, 22, 5);
    assert_int_equal(element_size(body, 3), 9);
    dgfem_mvc_destroy(body);
}

/* Only what a polygon meets is split: its neighbours gain hanging nodes, those along an edge too. */
static void test_neighbours_gain_nodes(void **state) {
    (void)state;
    dgfem_mvc *body = box_of(2, 1, 1);
    dgfem_mvc_cut_info info = cut_rectangle(body, -0.1, 0.4, -0.1, 1.1, 0.5);
    assert_int_equal(info.elements_split, 1);
    assert_int_equal(info.nodes_copied, 2);
    /* 12 nodes, 4 of the split, 2 at the end of the polygon, 2 copies */
    check_counts(body, 20, 3);
    int sizes[3], hanging = 0;
    for (int e = 0; e < 3; e++) sizes[e] = element_size(body, e), hanging += sizes[e] == 10;
    assert_true(hanging >= 1);
    dgfem_mvc_destroy(body);

    body = box_of(2, 2, 1);
    info = cut_rectangle(body, -0.1, 0.5, -0.1, 0.5, 0.5); /* to the inner edge exactly */
    assert_int_equal(info.elements_split, 1);
    int nine = 0;
    for (int e = 0; e < body->element_count; e++) nine += element_size(body, e) == 9;
    assert_int_equal(nine, 1);
    assert_int_equal(info.nodes_added, 4); /* 18 nodes and 4 make 22 of 5 elements, then copies */
    check_counts(body, 22 + info.nodes_copied, 5);
    dgfem_mvc_destroy(body);
}

static void test_cuts_have_known_counts(void **state) {
    (void)state;
    dgfem_mvc *body = box_of(3, 3, 3);
    dgfem_mvc_cut_info info = cut_rectangle(body, -0.1, 0.5, -0.1, 1.1, 0.5);
    assert_int_equal(64 + info.nodes_added, 80); /* before nodes are copied */
    assert_int_equal(info.pieces, 1);
    check_counts(body, 88, 33);
    info = cut_rectangle(body, 0.5, 1.1, -0.1, 1.1, 0.5);
    assert_int_equal(info.pieces, 2);
    check_counts(body, 104, 36);
    dgfem_mvc_destroy(body);

    body = box_of(3, 3, 3);
    assert_int_equal(cut(body, plane_at(0, 0, 1, 0.5)).pieces, 2);
    check_counts(body, 96, 36);
    assert_int_equal(cut(body, plane_at(1, 0, 0, 0.45)).pieces, 4);
    check_counts(body, 144, 48);
    dgfem_mvc_destroy(body);

    body = box_of(3, 3, 3);
    info = cut_rectangle(body, 0.2, 0.8, 0.2, 0.8, 0.5);
    assert_int_equal(info.pieces, 1);
    assert_int_equal(info.nodes_copied, 4);
    check_counts(body, 100, 36);
    dgfem_mvc_destroy(body);

    body = box_of(1, 1, 1); /* a pocket: a node inside opens it */
    info = cut_rectangle(body, 0.2, 0.8, 0.2, 0.8, 0.5);
    assert_int_equal(info.nodes_copied, 1);
    check_counts(body, 22, 2);
    dgfem_mvc_destroy(body);

    body = box_of(1, 1, 1); /* a mouth: a node in the middle of its lips opens it */
    info = cut_rectangle(body, 0.2, 0.8, -0.2, 0.8, 0.5);
    assert_int_equal(info.nodes_copied, 1);
    dgfem_vec3 lip = vec3(0.5, 0, 0.5);
    int lips = 0;
    for (int i = 0; i < body->node_count; i++) lips += check_distance(body->rest[i], lip) < 1e-5;
    assert_int_equal(lips, 2);
    check_status(dgfem_mvc_check(body), DGFEM_OK);
    dgfem_mvc_destroy(body);
}

/* ---- slivers ---- */

/* Tetrahedra, turned where they are inside out. */
static dgfem_mvc *tetrahedra_of(const double *points, int point_count, const int *corners, int count) {
    dgfem_tetrahedra_desc desc = dgfem_default_tetrahedra_desc();
    dgfem_mvc_desc body_desc = mvc_desc();
    dgfem_mesh *mesh = NULL;
    int turned[64];
    for (int t = 0; t < count; t++) {
        double d[3][3], det;
        for (int i = 0; i < 4; i++) turned[4 * t + i] = corners[4 * t + i];
        for (int i = 0; i < 9; i++)
            d[i / 3][i % 3] = points[3 * corners[4 * t + 1 + i / 3] + i % 3] - points[3 * corners[4 * t] + i % 3];
        det = d[0][0] * (d[1][1] * d[2][2] - d[1][2] * d[2][1]) - d[0][1] * (d[1][0] * d[2][2] - d[1][2] * d[2][0]) +
              d[0][2] * (d[1][0] * d[2][1] - d[1][1] * d[2][0]);
        if (det < 0) turned[4 * t] = corners[4 * t + 1], turned[4 * t + 1] = corners[4 * t];
    }
    desc.vertices = dgfem_points_in_double(points, point_count);
    desc.tetrahedra = turned, desc.tetrahedron_count = count;
    check_status(dgfem_mesh_create_tetrahedra(&desc, &mesh), DGFEM_OK);
    return mvc_of(&body_desc, mesh);
}

/* Two edges that cross: one new node, every neighbour has five. */
static void test_crossed_sliver(void **state) {
    (void)state;
    const double h = 0.01;
    const double points[] = {-1, 0, h, 0, -1, -h, 1, 0, h, 0, 1, -h, 0, 0, 1, 0, 0, -1};
    const int corners[] = {0, 1, 2, 3, 4, 0, 2, 1, 4, 0, 2, 3, 5, 1, 3, 0, 5, 1, 3, 2};
    dgfem_mvc_cut_info info;
    dgfem_mvc *body = tetrahedra_of(points, 6, corners, 5);
    double volume = (double)dgfem_mvc_rest_volume(body);
    check_status(dgfem_mvc_remove_slivers(body, DGFEM_R(0.02), &info), DGFEM_OK);
    assert_int_equal(info.slivers_removed, 1);
    assert_int_equal(info.slivers_left, 0);
    check_status(dgfem_mvc_check(body), DGFEM_OK);
    assert_int_equal(body->node_count, 7);
    assert_int_equal(body->element_count, 4);
    for (int e = 0; e < 4; e++) assert_int_equal(element_size(body, e), 5);
    check_near(dgfem_mvc_rest_volume(body), volume, 10 * CHECK_EPSILON);
    dgfem_mvc_destroy(body);
}

/* A cap: no new node, the element behind its largest face gets five. */
static void test_cap_sliver(void **state) {
    (void)state;
    const double points[] = {-1, -0.6, 0, 1, -0.6, 0, 0, 1, 0, 0, 0, 0.01, 0, 0, 1, 0, 0, -1};
    const int corners[] = {0, 1, 2, 3, 4, 0, 1, 3, 4, 1, 2, 3, 4, 2, 0, 3, 5, 0, 1, 2};
    dgfem_mvc_cut_info info;
    dgfem_mvc *body = tetrahedra_of(points, 6, corners, 5);
    int sizes[6] = {0, 0, 0, 0, 0, 0};
    double volume = (double)dgfem_mvc_rest_volume(body);
    check_status(dgfem_mvc_remove_slivers(body, DGFEM_R(0.02), &info), DGFEM_OK);
    assert_int_equal(info.slivers_removed, 1);
    check_status(dgfem_mvc_check(body), DGFEM_OK);
    assert_int_equal(body->node_count, 6);
    assert_int_equal(body->element_count, 4);
    for (int e = 0; e < 4; e++) sizes[element_size(body, e)]++;
    assert_int_equal(sizes[4], 3);
    assert_int_equal(sizes[5], 1);
    check_near(dgfem_mvc_rest_volume(body), volume, 10 * CHECK_EPSILON);
    dgfem_mvc_destroy(body);
}

/* A thin slab between two splits, and a needle between two more, vanish; the box stays a box. */
static void test_slabs_and_needles(void **state) {
    (void)state;
    for (int kind = 0; kind < 2; kind++) {
        dgfem_mvc_cut_desc desc = plain_cut();
        dgfem_mvc_cut_info info;
        dgfem_mvc *body = box_of(1, 1, 1);
        desc.snap = 0;
        for (int axis = 0; axis <= kind; axis++)
            for (int k = 0; k < 2; k++)
                check_status(
                    dgfem_mvc_split_plane(body, plane_at(axis == 1, 0, axis == 0, 0.5 + 0.01 * k), &desc, NULL),
                    DGFEM_OK);
        assert_int_equal(body->element_count, kind ? 9 : 3);
        check_status(dgfem_mvc_remove_slivers(body, DGFEM_R(0.02), &info), DGFEM_OK);
        print_message("%d of %d left\n", info.slivers_left, info.slivers_removed + info.slivers_left);
        check_status(dgfem_mvc_check(body), DGFEM_OK);
        assert_int_equal(info.slivers_left, 0);
        assert_int_equal(body->element_count, kind ? 4 : 2);
        check_sums(body, 1, vec3(0.5, 0.5, 0.5), 1000 * CHECK_EPSILON);
        dgfem_mvc_destroy(body);
    }
}

/* ---- state and conditions ---- */

/* Current positions and velocities that are functions of the rest position, linear on the edges of cubes. */
static dgfem_vec3 bent(dgfem_vec3 x, double size) {
    double a = (double)x.x, b = (double)x.y, c = (double)x.z;
    return vec3(a + size * b * c, b - size * a * c, c + size * (a + 0.5 * a * b));
}

static void bend(dgfem_mvc *body, double size) {
    for (int i = 0; i < body->node_count; i++) {
        body->position[i] = bent(body->rest[i], size);
        body->velocity[i] = vec3((double)body->rest[i].y, (double)body->rest[i].x, 1);
    }
}

/* New nodes lie on the current blade, and have the state between those of their edges. */
static void test_current_blade(void **state) {
    (void)state;
    dgfem_mvc *body = box_of(3, 3, 3);
    dgfem_mvc_cut_desc desc = plain_cut();
    dgfem_mvc_cut_info info;
    dgfem_plane plane = plane_at(0.6, 0, 0.8, 0.77);
    desc.current = 1;
    desc.snap = DGFEM_R(0.01);
    bend(body, 0.2);
    check_status(dgfem_mvc_cut_plane(body, plane, &desc, &info), DGFEM_OK);
    check_status(dgfem_mvc_check(body), DGFEM_OK);
    assert_int_equal(info.pieces, 2);
    int on = 0;
    for (int i = 0; i < body->node_count; i++) {
        dgfem_vec3 x = body->position[i];
        double distance = 0.6 * (double)x.x + 0.8 * (double)x.z - 0.77;
        on += fabs(distance) < 10 * CHECK_EPSILON;
        check_near3(x, bent(body->rest[i], 0.2), 1e-3 + 10 * CHECK_EPSILON);
        check_near3(body->velocity[i], vec3((double)body->rest[i].y, (double)body->rest[i].x, 1), 20 * CHECK_EPSILON);
    }
    assert_true(on >= 2 * (info.nodes_added - 1));
    check_sums(body, 1, vec3(0.5, 0.5, 0.5), 100 * CHECK_EPSILON);
    dgfem_mvc_destroy(body);
}

/* Copies of held nodes, and nodes between two of them, are held. */
static void test_conditions_follow(void **state) {
    (void)state;
    dgfem_mvc *body = box_of(2, 2, 2);
    int nodes[64], id, held = 0;
    int count = dgfem_mvc_nodes_on_plane(body, plane_at(1, 0, 0, 0), DGFEM_R(1e-6), nodes, 64);
    assert_int_equal(count, 9);
    check_status(dgfem_mvc_fix_nodes(body, nodes, count, DGFEM_MVC_XYZ, vec3(0, 0, 0), &id), DGFEM_OK);
    cut(body, plane_at(0, 0, 1, 0.3));
    count = dgfem_mvc_nodes_on_plane(body, plane_at(1, 0, 0, 0), DGFEM_R(1e-6), nodes, 64);
    assert_int_equal(count, 9 + 2 * 3);
    assert_int_equal(body->condition_count, 1);
    assert_int_equal(body->conditions[0].count, count);
    for (int i = 0; i < count; i++)
        for (int k = 0; k < body->conditions[0].count; k++) held += body->conditions[0].items[k] == nodes[i];
    assert_int_equal(held, count);
    dgfem_mvc_destroy(body);
}

/* Copies of a node share its force and its spring, however often it is listed. */
static void test_shares_follow(void **state) {
    (void)state;
    dgfem_mvc *body = box_of(2, 2, 2);
    int nodes[3], force, pin;
    for (int i = 0; i < 3; i++)
        nodes[i] = dgfem_mvc_nearest_node(body, i ? vec3(0.5, 0.5, 0.5) : vec3(1, 1, 1)); /* the second one twice */
    check_status(dgfem_mvc_set_gravity(body, vec3(0, 0, 0)), DGFEM_OK);
    check_status(dgfem_mvc_add_force(body, nodes, 3, vec3(1, 2, 3), &force), DGFEM_OK);
    check_status(dgfem_mvc_pin(body, nodes[1], 7, &pin), DGFEM_OK);
    cut(body, plane_at(0, 0, 1, 0.5));
    cut(body, plane_at(1, 0, 0, 0.5));
    dgfem_vec3 *out = (dgfem_vec3 *)malloc((size_t)body->node_count * sizeof *out), sum = vec3(0, 0, 0);
    assert_non_null(out);
    check_status(dgfem_mvc_external_force(body, out), DGFEM_OK);
    for (int i = 0; i < body->node_count; i++) {
        int is_middle =
            (double)body->rest[i].x == 0.5 && (double)body->rest[i].y == 0.5 && (double)body->rest[i].z == 0.5;
        int is_corner = (double)body->rest[i].x == 1 && (double)body->rest[i].y == 1 && (double)body->rest[i].z == 1;
        check_near(out[i].y, is_middle ? 2 * 2.0 / 4 : is_corner ? 2 : 0, 1e-6); /* four copies */
        sum.x += out[i].x, sum.y += out[i].y, sum.z += out[i].z;
    }
    check_near3(sum, vec3(3, 6, 9), 1e-5);
    assert_int_equal(body->condition_count, 2);
    assert_int_equal(body->conditions[0].count, 1 + 2 * 4);
    assert_int_equal(body->conditions[1].count, 4);
    for (int i = 0; i < 4; i++) {
        const dgfem_mvc_condition *spring = &body->conditions[1];
        check_near(spring->share[i], 0.25, 1e-6);
        check_near3(body->rest[spring->items[i]], vec3(0.5, 0.5, 0.5), 0);
        for (int j = 0; j < i; j++) assert_int_not_equal(spring->items[i], spring->items[j]);
    }
    free(out);
    dgfem_mvc_destroy(body);
}

typedef struct told {
    int calls, elements;
    double volume;
} told;

static void on_piece(void *user, const dgfem_mvc *body, int piece, const int *elements, int count) {
    told *t = (told *)user;
    int *piece_of = (int *)malloc((size_t)body->element_count * sizeof(int)), pieces;
    check_status(dgfem_mvc_pieces(body, piece_of, NULL, 0, &pieces), DGFEM_OK);
    for (int i = 0; i < count; i++) {
        assert_int_equal(piece_of[elements[i]], piece);
        t->volume += (double)body->volume[elements[i]];
    }
    t->calls++;
    t->elements += count;
    free(piece_of);
}

/* The smaller part is told of; pieces have their mass, place and motion. */
static void test_pieces_are_told(void **state) {
    (void)state;
    dgfem_mvc *body = box_of(3, 3, 3);
    dgfem_mvc_cut_desc desc = plain_cut();
    dgfem_piece pieces[2];
    told t;
    int count;
    memset(&t, 0, sizeof t);
    desc.new_piece = on_piece, desc.new_piece_user = &t;
    for (int i = 0; i < body->node_count; i++) body->velocity[i] = vec3(0, 0, 2);
    check_status(dgfem_mvc_cut_plane(body, plane_at(0, 0, 1, 0.2), &desc, NULL), DGFEM_OK);
    assert_int_equal(t.calls, 1);
    assert_int_equal(t.elements, 9);
    check_near(t.volume, 0.2, 10 * CHECK_EPSILON);
    check_status(dgfem_mvc_pieces(body, NULL, pieces, 2, &count), DGFEM_OK);
    assert_int_equal(count, 2);
    int small = pieces[1].volume < pieces[0].volume;
    check_near(pieces[small].volume, 0.2, 10 * CHECK_EPSILON);
    check_near(pieces[small].mass, 0.2, 10 * CHECK_EPSILON);
    check_near3(pieces[small].centre, vec3(0.5, 0.5, 0.1), 10 * CHECK_EPSILON);
    check_near3(pieces[small].momentum, vec3(0, 0, 0.4), 10 * CHECK_EPSILON);
    check_near3(pieces[small].spin, vec3(0, 0, 0), 10 * CHECK_EPSILON);
    dgfem_mvc_destroy(body);
}

/* What misses or repeats an earlier cut changes nothing. */
static void test_nothing_to_cut(void **state) {
    (void)state;
    dgfem_mvc *body = box_of(2, 2, 2);
    int revision = body->revision;
    dgfem_mvc_cut_info info = cut(body, plane_at(0, 0, 1, 2));
    assert_int_equal(info.faces_cut + info.elements_split, 0);
    assert_int_equal(info.pieces, 1);
    assert_int_equal(cut(body, plane_at(0, 0, 1, 1)).faces_cut, 0); /* on the surface */
    assert_int_equal(body->revision, revision);
    assert_int_equal(cut(body, plane_at(0, 0, 1, 0.5)).faces_cut, 4); /* along faces that are there */
    assert_int_equal(body->revision, revision + 1);
    assert_int_equal(cut(body, plane_at(0, 0, 1, 0.5)).faces_cut, 0);
    assert_int_equal(body->revision, revision + 1);
    check_status(dgfem_mvc_check(body), DGFEM_OK);
    dgfem_mvc_destroy(body);
}

/* The prism of height 1 over an outline, counter-clockwise, of at most 8 points. */
static dgfem_polyhedron *prism(const double (*outline)[2], int n) {
    dgfem_polyhedron_desc desc = dgfem_default_polyhedron_desc();
    dgfem_polyhedron *cell = NULL;
    dgfem_vec3 x[16];
    int loops[48], starts[11], count = 2 * n;
    for (int i = 0; i < n; i++) {
        x[i] = vec3(outline[i][0], outline[i][1], 0), x[n + i] = vec3(outline[i][0], outline[i][1], 1);
        loops[i] = n - 1 - i, loops[n + i] = n + i;
    }
    starts[0] = 0, starts[1] = n;
    for (int i = 0; i < n; i++) {
        int j = (i + 1) % n;
        starts[2 + i] = count;
        loops[count++] = i, loops[count++] = j, loops[count++] = n + j, loops[count++] = n + i;
    }
    starts[2 + n] = count;
    desc.vertices = x, desc.vertex_count = 2 * n, desc.face_count = n + 2;
    desc.loop_start = starts, desc.loop_vertices = loops;
    check_status(dgfem_polyhedron_create(&desc, &cell), DGFEM_OK);
    return cell;
}

/* What the plane x + y = 3.9 would cut off the L does not see itself from its centroid, (2.13, 2.13), for the inner
   corner is at (2, 2): so the L stays whole, and the box beside it is cut up to it. */
static void test_what_cannot_be_split(void **state) {
    (void)state;
    static const double l[6][2] = {{0, 0}, {3, 0}, {3, 2}, {2, 2}, {2, 3}, {0, 3}};
    static const double box[4][2] = {{3, 0}, {4, 0}, {4, 2}, {3, 2}};
    const dgfem_plane plane = plane_at(1, 1, 0, 3.9);
    dgfem_polyhedron *cells[2];
    dgfem_weld_desc weld = dgfem_default_weld_desc();
    dgfem_mvc_desc desc = mvc_desc();
    dgfem_mvc_cut_desc thin = plain_cut();
    dgfem_mvc_cut_info info;
    dgfem_mesh *mesh = NULL;
    cells[0] = prism(l, 6), cells[1] = prism(box, 4);
    check_status(dgfem_mesh_create_polyhedra((const dgfem_polyhedron *const *)cells, 2, &weld, &mesh), DGFEM_OK);
    dgfem_polyhedron_destroy(cells[0]), dgfem_polyhedron_destroy(cells[1]);
    dgfem_mvc *body = mvc_of(&desc, mesh);
    assert_int_equal(body->node_count, 16);

    for (int k = 0; k < 2; k++) {
        int revision = body->revision;
        thin.snap = k ? 0 : DGFEM_R(0.05);
        check_status(dgfem_mvc_split_element(body, 0, plane, &thin, &info), DGFEM_OK);
        assert_int_equal(info.elements_kept, 1);
        assert_int_equal(info.elements_split + info.nodes_added + info.faces_cut, 0);
        assert_int_equal(body->revision, revision);
    }

    info = cut(body, plane);
    assert_int_equal(info.elements_kept, 1);
    assert_int_equal(info.elements_split, 1);
    assert_int_equal(info.nodes_added, 4);
    assert_int_equal(info.nodes_copied, 2); /* those on the L hold both parts */
    assert_int_equal(info.faces_cut, 1);
    assert_int_equal(info.pieces, 1);
    assert_int_equal(body->node_count, 22);
    assert_int_equal(body->element_count, 3);
    assert_int_equal(element_size(body, 0), 14); /* has got hanging nodes */
    check_status(dgfem_mvc_check(body), DGFEM_OK);
    check_near((double)dgfem_mvc_rest_volume(body), 10, 100 * CHECK_EPSILON);
    dgfem_mvc_destroy(body);
}

/* An L-shaped cut: its inner corner stays whole. */
static void test_polygon_that_is_not_convex(void **state) {
    (void)state;
    dgfem_mvc *body = box_of(4, 4, 3);
    dgfem_mvc_cut_desc desc = plain_cut();
    dgfem_mvc_cut_info info;
    dgfem_vec3 p[6];
    p[0] = vec3(-0.1, -0.1, 0.5), p[1] = vec3(0.8, -0.1, 0.5), p[2] = vec3(0.8, 0.3, 0.5);
    p[3] = vec3(0.3, 0.3, 0.5), p[4] = vec3(0.3, 0.8, 0.5), p[5] = vec3(-0.1, 0.8, 0.5);
    check_status(dgfem_mvc_cut_polygon(body, points_of(p, 6), &desc, &info), DGFEM_OK);
    check_status(dgfem_mvc_check(body), DGFEM_OK);
    check_sums(body, 1, vec3(0.5, 0.5, 0.5), 100 * CHECK_EPSILON);
    double area = 0;
    for (int f = 0; f < body->face_count; f++) { /* of the cut from above */
        int owner[2], triangles[3 * 64];
        dgfem_mvc_face_elements(body, f, owner);
        int count = dgfem_mvc_face_triangles(body, f, triangles, 64);
        for (int t = 0; t < count && owner[1] == DGFEM_NONE; t++) {
            const dgfem_vec3 *x = body->rest;
            dgfem_vec3 a = x[triangles[3 * t]], b = x[triangles[3 * t + 1]], c = x[triangles[3 * t + 2]];
            if (fabs((double)a.z - 0.5) + fabs((double)b.z - 0.5) + fabs((double)c.z - 0.5) > 1e-5) continue;
            area += 0.25 * fabs((double)((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)));
        }
    }
    check_near(area, 0.8 * 0.8 - 0.5 * 0.5, 100 * CHECK_EPSILON);
    dgfem_mvc_destroy(body);
}

/* Two triangles make a square; a folded pair cuts off a roof. */
static void test_surface(void **state) {
    (void)state;
    static const int triangles[] = {0, 1, 2, 0, 2, 3, 1, 1, 2};
    dgfem_mvc_cut_desc desc = plain_cut();
    dgfem_mvc_cut_info info;
    dgfem_vec3 p[4];
    dgfem_mvc *body = box_of(3, 3, 3);
    rectangle(p, -0.1, 1.1, -0.1, 1.1, 0.5);
    check_status(dgfem_mvc_cut_surface(body, points_of(p, 4), triangles, 3, &desc, &info), DGFEM_OK);
    check_status(dgfem_mvc_check(body), DGFEM_OK);
    assert_int_equal(info.pieces, 2);
    check_sums(body, 1, vec3(0.5, 0.5, 0.5), 100 * CHECK_EPSILON);
    dgfem_mvc_destroy(body);

    static const int roof[] = {0, 1, 2, 0, 2, 3, 3, 2, 4, 3, 4, 5};
    dgfem_vec3 q[6];
    dgfem_piece pieces[2];
    int count;
    q[0] = vec3(-0.2, -0.1, 0.36), q[1] = vec3(-0.2, 1.1, 0.36), q[3] = vec3(0.5, -0.1, 0.64);
    q[2] = vec3(0.5, 1.1, 0.64), q[5] = vec3(1.2, -0.1, 0.36), q[4] = vec3(1.2, 1.1, 0.36);
    body = box_of(4, 2, 3);
    desc.snap = 0;
    check_status(dgfem_mvc_cut_surface(body, points_of(q, 6), roof, 4, &desc, &info), DGFEM_OK);
    check_status(dgfem_mvc_check(body), DGFEM_OK);
    check_status(dgfem_mvc_pieces(body, NULL, pieces, 2, &count), DGFEM_OK);
    assert_int_equal(count, 2);
    check_near((double)pieces[0].volume, 0.54, 1000 * CHECK_EPSILON); /* mean height below the roof */
    dgfem_mvc_destroy(body);
}

/* A curved sheet of many triangles, in one call or in progressive ones, cuts off all that is above. */
static void test_curved_surface(void **state) {
    (void)state;
    for (int kind = 0; kind < 4; kind++) {
        int stages = kind & 1 ? 10 : 5, triangles[6 * 10], count = 0, pieces;
        double bow = kind & 2 ? 0.2 : 0.03, expected = 0, last = 0;
        dgfem_mvc_cut_desc desc = plain_cut();
        dgfem_mvc_cut_info info;
        dgfem_vec3 p[22];
        dgfem_piece piece[2];
        dgfem_mvc *body = box_of(3, 3, 3);
        for (int s = 0; s <= stages; s++) {
            double x = 1.25 - 1.5 * s / stages, z = 0.4 + bow * sin(pi * s / stages), low, high;
            for (int k = 0; k < 2; k++) p[2 * s + k] = vec3(x, k ? 1.3 : -0.3, z);
            if (s) { /* volume below the sheet: what of this facet is over the box */
                double from = fmin(x + 1.5 / stages, 1), to = fmax(x, 0), slope = (z - last) / (-1.5 / stages);
                low = z + slope * (to - x), high = z + slope * (from - x);
                if (from > to) expected += (from - to) * (low + high) / 2;
            }
            last = z;
        }
        for (int s = 0; s < stages; s++) {
            static const int pattern[6] = {0, 1, 2, 1, 3, 2};
            for (int i = 0; i < 6; i++) triangles[count++] = 2 * s + pattern[i];
        }
        check_status(dgfem_mvc_cut_surface(body, points_of(p, 2 * stages + 2), triangles, stages, &desc, &info),
                     DGFEM_OK);
        assert_int_equal(info.pieces, 1);
        check_status(
            dgfem_mvc_cut_surface(body, points_of(p, 2 * stages + 2), triangles + 3 * stages, stages, &desc, &info),
            DGFEM_OK);
        check_status(dgfem_mvc_check(body), DGFEM_OK);
        check_status(dgfem_mvc_pieces(body, NULL, piece, 2, &pieces), DGFEM_OK);
        assert_int_equal(pieces, 2);
        int lower = piece[1].centre.z < piece[0].centre.z;
        check_near(piece[lower].volume, expected, 1000 * CHECK_EPSILON);
        dgfem_mvc_destroy(body);
    }
}

/* ---- patch test ---- */

/* A box split by two random planes and cut by a random triangle. */
static dgfem_mvc *split_and_cut(check_random *random, const dgfem_mvc_desc *desc, double snap) {
    dgfem_mvc *body = mvc_of(desc, mvc_grid(3, 3, 3, 1, 1, 1));
    dgfem_mvc_cut_desc how = plain_cut();
    how.snap = (dgfem_real)snap;
    how.remove_slivers = snap > 0;
    for (int c = 0; c < 3; c++) {
        dgfem_vec3 n = check_random_vec3(random, -1, 1), o = check_random_vec3(random, 0.3, 0.7), p[3];
        dgfem_plane plane;
        plane.normal = n, plane.offset = n.x * o.x + n.y * o.y + n.z * o.z;
        for (int i = 0; i < 3; i++) p[i] = check_random_vec3(random, 0.1, 0.9);
        if (c < 2) check_status(dgfem_mvc_split_plane(body, plane, &how, NULL), DGFEM_OK);
        else check_status(dgfem_mvc_cut_polygon(body, points_of(p, 3), &how, NULL), DGFEM_OK);
    }
    check_status(dgfem_mvc_check(body), DGFEM_OK);
    return body;
}

/* Largest error of the positions, all boundary nodes moved linearly. */
static double patch_error(check_random *random, dgfem_mvc *body) {
    mvc_affine field = mvc_random_affine(random, 1);
    int count, id, *nodes = mvc_boundary(body, &count);
    double error = 0;
    check_status(dgfem_mvc_fix_nodes(body, nodes, count, DGFEM_MVC_XYZ, vec3(0, 0, 0), &id), DGFEM_OK);
    check_status(dgfem_mvc_move_fixture(body, id, field.linear, field.offset), DGFEM_OK);
    check_status(dgfem_mvc_solve_static(body, NULL, NULL), DGFEM_OK);
    free(nodes);
    for (int i = 0; i < body->node_count; i++) {
        dgfem_vec3 x = body->rest[i], u = mvc_affine_at(&field, x);
        double off =
            check_distance(body->position[i], vec3((double)(x.x + u.x), (double)(x.y + u.y), (double)(x.z + u.z)));
        if (!(off <= error)) error = off;
    }
    return error;
}

/* Hanging nodes and cracks do no harm, nor do faces that snapping has bent: elements that are not quite convex have now
   and then a sample near the plane of another of their triangles, where gradients lose digits. */
static void test_patch_of_cut_meshes(void **state) {
    (void)state;
    check_random random = check_random_seeded(3);
    double worst[2] = {0, 0};
    for (int m = 0; m < (DGFEM_REAL_IS_FLOAT && !check_long() ? 4 : 8); m++) {
        dgfem_mvc_desc desc = mvc_desc();
        desc.quadrature = m % 4 < 2 ? DGFEM_MVC_PAPER : DGFEM_MVC_TET4;
        desc.warp = 0;
        dgfem_mvc *body = split_and_cut(&random, &desc, m % 2 ? 0.05 : 0);
        double error = patch_error(&random, body);
        if (!(error <= worst[m % 2])) worst[m % 2] = error;
        dgfem_mvc_destroy(body);
    }
    print_message("largest error %.1e, with snapping %.1e\n", worst[0], worst[1]);
    check_near(worst[0], 0, DGFEM_REAL_IS_FLOAT ? 2e-4 : 1e-12);
    check_near(worst[1], 0, DGFEM_REAL_IS_FLOAT ? 2e-4 : 1e-10);
}

/* ---- random cuts ---- */

static dgfem_vec3 added(dgfem_vec3 a, double s, dgfem_vec3 b) {
    return vec3((double)a.x + s * (double)b.x, (double)a.y + s * (double)b.y, (double)a.z + s * (double)b.z);
}

/* A point of a blade: anywhere; or, where degenerate, often at a node, in the middle of two, or hardly beside one. */
static dgfem_vec3 blade_point(check_random *random, const dgfem_mvc *body, int degenerate) {
    int kind = degenerate ? check_random_int(random, 4) : 0;
    if (!kind) return check_random_vec3(random, -0.2, 1.2);
    dgfem_vec3 a = body->rest[check_random_int(random, body->node_count)];
    if (kind == 1) return a;
    if (kind == 2) {
        dgfem_vec3 b = body->rest[check_random_int(random, body->node_count)];
        return added(vec3((double)a.x / 2, (double)a.y / 2, (double)a.z / 2), 0.5, b);
    }
    return added(a, 1,
                 vec3(check_random_real(random, -1e-6, 1e-6), check_random_real(random, -1e-9, 1e-9),
                      check_random_real(random, -1e-3, 1e-3)));
}

/* A regular polygon or a star about a point, through two others. Returns the number of corners. */
static int blade_polygon(check_random *random, const dgfem_mvc *body, int degenerate, dgfem_vec3 *p) {
    int n = 3 + check_random_int(random, 6), star = check_random_int(random, 2);
    double radius = check_random_real(random, 0.1, 0.8);
    dgfem_vec3 o = blade_point(random, body, degenerate);
    dgfem_vec3 a = added(blade_point(random, body, degenerate), -1, o), b;
    double length = check_distance(a, vec3(0, 0, 0)), dot;
    if (!(length > 1e-3)) a = vec3(1, 0, 0), length = 1;
    a = vec3((double)a.x / length, (double)a.y / length, (double)a.z / length);
    b = added(blade_point(random, body, degenerate), -1, o);
    dot = (double)(a.x * b.x + a.y * b.y + a.z * b.z);
    b = added(b, -dot, a);
    length = check_distance(b, vec3(0, 0, 0));
    if (!(length > 1e-3)) return 0;
    b = vec3((double)b.x / length, (double)b.y / length, (double)b.z / length);
    for (int i = 0; i < n; i++) {
        double r = star ? radius * check_random_real(random, 0.3, 1) : radius;
        p[i] = added(added(o, r * cos(2 * pi * i / n), a), r * sin(2 * pi * i / n), b);
    }
    return n;
}

/* One cut of a random kind. */
static dgfem_status random_cut(check_random *random, dgfem_mvc *body, int *removed) {
    static const int fan[] = {0, 1, 2, 0, 2, 3, 0, 3, 4, 0, 4, 5};
    int degenerate = check_random_int(random, 3) == 0, kind = check_random_int(random, 3);
    dgfem_vec3 p[9];
    dgfem_mvc_cut_desc desc = plain_cut();
    dgfem_mvc_cut_info info;
    dgfem_status status = DGFEM_OK;
    desc.remove_slivers = 1;
    memset(&info, 0, sizeof info);
    for (int i = 0; i < 6; i++) p[i] = blade_point(random, body, degenerate);
    if (kind == 0) {
        double a[3], b[3], n[3];
        a[0] = (double)(p[1].x - p[0].x), a[1] = (double)(p[1].y - p[0].y), a[2] = (double)(p[1].z - p[0].z);
        b[0] = (double)(p[2].x - p[0].x), b[1] = (double)(p[2].y - p[0].y), b[2] = (double)(p[2].z - p[0].z);
        for (int i = 0; i < 3; i++) n[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
        if (!(n[0] * n[0] + n[1] * n[1] + n[2] * n[2] > 1e-8)) return DGFEM_OK;
        dgfem_plane plane = plane_at(n[0], n[1], n[2], 0);
        plane.offset = plane.normal.x * p[0].x + plane.normal.y * p[0].y + plane.normal.z * p[0].z;
        status = dgfem_mvc_cut_plane(body, plane, &desc, &info);
    } else if (kind == 1) {
        int n = blade_polygon(random, body, degenerate, p);
        if (n) status = dgfem_mvc_cut_polygon(body, points_of(p, n), &desc, &info);
    } else {
        int n = 2 + check_random_int(random, 3);
        status = dgfem_mvc_cut_surface(body, points_of(p, 6), fan, n, &desc, &info);
    }
    *removed += info.slivers_removed;
    return status;
}

/* Planes, polygons and surfaces, a third of them through nodes on purpose: no failure, no lost volume. */
static void test_random_cuts(void **state) {
    (void)state;
    int wanted = check_long() ? (DGFEM_REAL_IS_FLOAT ? 2000 : 10000) : DGFEM_REAL_IS_FLOAT ? 20 : 60;
    int cuts = 0, removed = 0, most = 0;
    double worst = 0, tolerance = DGFEM_REAL_IS_FLOAT ? 1e-4 : 1e-10;
    for (int run = 0; cuts < wanted; run++) {
        check_random random;
        dgfem_mvc_desc desc = mvc_desc();
        desc.quadrature = DGFEM_MVC_PAPER; /* the quickest */
        random.state = (uint64_t)(1000 + run);
        int nx = 1 + check_random_int(&random, 3), ny = 1 + check_random_int(&random, 3);
        int nz = 1 + check_random_int(&random, 3), kind = check_random_int(&random, 4);
        dgfem_mvc *body = mvc_of(&desc, kind ? mvc_grid(nx, ny, nz, 1, 1, 1)
                                             : mvc_mesh(nx == 1 ? MVC_TETRAHEDRA : MVC_VORONOI, 2 + ny, (uint64_t)run));
        for (int c = 0; c < 8 && cuts < wanted && body->element_count < 50; c++, cuts++) {
            dgfem_status status = random_cut(&random, body, &removed);
            double volume = 0;
            if (!status) status = dgfem_mvc_check(body);
            for (int e = 0; e < body->element_count; e++) volume += (double)body->volume[e];
            if (status || !(fabs(volume - 1) <= tolerance))
                fail_msg("run %d, cut %d: %s, volume off by %g", run, c, dgfem_status_text(status), volume - 1);
            worst = fmax(worst, fabs(volume - 1));
        }
        check_sums(body, 1, vec3(0.5, 0.5, 0.5), 10 * tolerance);
        if (body->element_count > most) most = body->element_count;
        dgfem_mvc_destroy(body);
    }
    print_message("%d cuts: volume off by %.1e at most, %d slivers removed, up to %d elements\n", cuts, worst, removed,
                  most);
}

/* ---- failures ---- */

/* One number of all that a cut might change. */
static double fingerprint(const dgfem_mvc *body) {
    double sum = body->revision + 1e3 * body->node_count + 1e6 * body->element_count + 1e7 * body->face_count;
    for (int i = 0; i < body->node_count; i++)
        sum += (i + 1) * ((double)body->position[i].x + 2 * (double)body->velocity[i].y + (double)body->mass[i]);
    for (int c = 0; c < body->condition_count; c++) sum += body->conditions[c].count;
    return sum;
}

typedef dgfem_status (*cut_fn)(dgfem_mvc *body);

static dgfem_status cut_a_plane(dgfem_mvc *body) {
    dgfem_mvc_cut_desc desc = dgfem_default_mvc_cut_desc();
    return dgfem_mvc_cut_plane(body, plane_at(0.3, 0.2, 1, 0.7), &desc, NULL);
}
static dgfem_status cut_a_polygon(dgfem_mvc *body) {
    dgfem_vec3 p[4];
    rectangle(p, -0.1, 0.8, 0.3, 0.8, 0.4);
    return dgfem_mvc_cut_polygon(body, points_of(p, 4), NULL, NULL);
}
static dgfem_status cut_a_surface(dgfem_mvc *body) {
    static const int triangles[] = {0, 1, 2, 0, 2, 3};
    dgfem_vec3 p[4];
    rectangle(p, -0.1, 0.8, 0.3, 0.8, 0.4);
    p[2].z += DGFEM_R(0.2);
    return dgfem_mvc_cut_surface(body, points_of(p, 4), triangles, 2, NULL, NULL);
}
static dgfem_status cut_slivers(dgfem_mvc *body) { return dgfem_mvc_remove_slivers(body, DGFEM_R(0.02), NULL); }

static void test_every_failing_allocation(void **state) {
    (void)state;
    static const cut_fn cuts[] = {cut_a_plane, cut_a_polygon, cut_a_surface, cut_slivers};
    for (int k = 0; k < 4; k++) {
        check_host host;
        dgfem_mvc_desc desc = mvc_desc();
        dgfem_mvc_cut_desc thin = plain_cut();
        int id, node = 0;
        desc.hooks = check_hooks(&host);
        dgfem_mvc *body = mvc_of(&desc, mvc_grid(2, 1, 1, 1, 1, 1));
        check_status(dgfem_mvc_fix_nodes(body, &node, 1, DGFEM_MVC_XYZ, vec3(0, 0, 0), &id), DGFEM_OK);
        check_status(dgfem_mvc_pin(body, node, 1, NULL), DGFEM_OK);
        thin.snap = 0;
        for (int i = 0; k == 3 && i < 2; i++)
            check_status(dgfem_mvc_split_plane(body, plane_at(0, 0, 1, 0.5 + 0.01 * i), &thin, NULL), DGFEM_OK);
        double before = fingerprint(body);
        long live = host.live, failures = 0;
        for (;; failures += DGFEM_REAL_IS_FLOAT && !check_long() ? 3 : 1) { /* sanitizers are slow */
            host.calls = 0, host.fail_from = failures + 1;
            dgfem_status status = cuts[k](body);
            if (!status) break;
            check_status(status, DGFEM_ERROR_MEMORY);
            check_logged(&host, "out of memory");
            assert_int_equal(host.live, live);
            assert_true(fingerprint(body) == before);
        }
        host.fail_from = 0;
        print_message("%ld allocations\n", failures);
        assert_true(failures > 20);
        assert_true(fingerprint(body) != before);
        check_status(dgfem_mvc_check(body), DGFEM_OK);
        dgfem_mvc_destroy(body);
        assert_int_equal(host.live, 0);
    }
}

static void test_bad_cuts(void **state) {
    (void)state;
    check_host host;
    dgfem_mvc_desc desc = mvc_desc();
    dgfem_mvc_cut_desc bad = plain_cut();
    dgfem_vec3 p[5];
    int triangle[3] = {0, 1, 7};
    desc.hooks = check_hooks(&host);
    dgfem_mvc *body = mvc_of(&desc, mvc_grid(2, 1, 1, 1, 1, 1));
    double before = fingerprint(body);
    check_status(dgfem_mvc_cut_plane(NULL, plane_at(0, 0, 1, 0.5), NULL, NULL), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_mvc_cut_plane(body, plane_at(0, 0, 0, 0.5), NULL, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "normal is zero");
    check_status(dgfem_mvc_cut_plane(body, plane_at(0, 0, DGFEM_REAL_IS_FLOAT ? 1e30 : 1e200, 0.5), NULL, NULL),
                 DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "length of the plane's normal");
    check_status(dgfem_mvc_cut_plane(body, plane_at(0, 0, 1, (double)NAN), NULL, NULL), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "plane");
    bad.cookie = 0;
    check_status(dgfem_mvc_cut_plane(body, plane_at(0, 0, 1, 0.5), &bad, NULL), DGFEM_ERROR_DESCRIPTOR);
    bad = plain_cut(), bad.snap = DGFEM_R(0.5);
    check_status(dgfem_mvc_cut_plane(body, plane_at(0, 0, 1, 0.5), &bad, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "snap 0.5");
    check_status(dgfem_mvc_split_element(body, 2, plane_at(0, 0, 1, 0.5), NULL, NULL), DGFEM_ERROR_INDEX);
    check_logged(&host, "no element 2");
    check_status(dgfem_mvc_remove_slivers(body, (dgfem_real)NAN, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "quality");
    rectangle(p, 0, 1, 0, 1, 0.5);
    check_status(dgfem_mvc_cut_polygon(body, points_of(p, 2), NULL, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "polygon of 2");
    p[4] = p[2], p[2] = p[3], p[3] = p[4]; /* a bow tie */
    check_status(dgfem_mvc_cut_polygon(body, points_of(p, 4), NULL, NULL), DGFEM_ERROR_DEGENERATE);
    check_logged(&host, "no area");
    p[3].x = 2;
    check_status(dgfem_mvc_cut_polygon(body, points_of(p, 4), NULL, NULL), DGFEM_ERROR_NOT_SIMPLE);
    check_logged(&host, "crosses");
    rectangle(p, 0, 1, 0, 1, 0.5);
    p[1].z = DGFEM_R(0.7);
    check_status(dgfem_mvc_cut_polygon(body, points_of(p, 4), NULL, NULL), DGFEM_ERROR_NOT_PLANAR);
    check_logged(&host, "off its plane");
    p[1].z = (dgfem_real)NAN;
    check_status(dgfem_mvc_cut_polygon(body, points_of(p, 4), NULL, NULL), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "point 1");
    p[1].z = 0;
    check_status(dgfem_mvc_cut_surface(body, points_of(p, 4), triangle, 1, NULL, NULL), DGFEM_ERROR_INDEX);
    check_logged(&host, "vertex 7");
    check_status(dgfem_mvc_cut_surface(body, points_of(p, 4), NULL, 1, NULL, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "no indices");
    assert_true(fingerprint(body) == before);
    dgfem_mvc_destroy(body);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_splits_have_known_counts),
        cmocka_unit_test(test_neighbours_gain_nodes),
        cmocka_unit_test(test_cuts_have_known_counts),
        cmocka_unit_test(test_crossed_sliver),
        cmocka_unit_test(test_cap_sliver),
        cmocka_unit_test(test_slabs_and_needles),
        cmocka_unit_test(test_current_blade),
        cmocka_unit_test(test_conditions_follow),
        cmocka_unit_test(test_shares_follow),
        cmocka_unit_test(test_pieces_are_told),
        cmocka_unit_test(test_nothing_to_cut),
        cmocka_unit_test(test_what_cannot_be_split),
        cmocka_unit_test(test_polygon_that_is_not_convex),
        cmocka_unit_test(test_surface),
        cmocka_unit_test(test_curved_surface),
        cmocka_unit_test(test_patch_of_cut_meshes),
        cmocka_unit_test(test_random_cuts),
        cmocka_unit_test(test_every_failing_allocation),
        cmocka_unit_test(test_bad_cuts),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
