/* Plane splits of polyhedra and meshes: caps, holes, voids, components, planes through vertices, edges and faces,
   snapping, splits of a part of the mesh, failures. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check.h"
#include "shapes.h"

static shape solid, scratch; /* large: not on the stack */

static dgfem_vec3 vec(double x, double y, double z) {
    dgfem_vec3 v;
    v.x = (dgfem_real)x, v.y = (dgfem_real)y, v.z = (dgfem_real)z;
    return v;
}

static dgfem_plane plane_at(double x, double y, double z, double offset) {
    dgfem_plane plane;
    plane.normal = vec(x, y, z);
    plane.offset = (dgfem_real)offset;
    return plane;
}

static double dot3(dgfem_vec3 a, dgfem_vec3 b) {
    return (double)a.x * (double)b.x + (double)a.y * (double)b.y + (double)a.z * (double)b.z;
}

static double volume_of(const dgfem_polyhedron *p) { return p ? (double)dgfem_polyhedron_measure(p).volume : 0; }

static int components_of(const dgfem_polyhedron *p) {
    int count = 0;
    if (p) check_status(dgfem_polyhedron_component_count(p, &count), DGFEM_OK);
    return count;
}

/* The polyhedron as a mesh of one element. */
static dgfem_mesh *mesh_of(const shape *s) {
    dgfem_weld_desc desc = dgfem_default_weld_desc();
    dgfem_polyhedron *polyhedron = shape_polyhedron(s);
    dgfem_mesh *mesh = NULL;
    const dgfem_polyhedron *list[1];
    list[0] = polyhedron;
    check_status(dgfem_mesh_create_polyhedra(list, 1, &desc, &mesh), DGFEM_OK);
    dgfem_polyhedron_destroy(polyhedron);
    return mesh;
}

static dgfem_mesh *grid_of(int nx, int ny, int nz) {
    dgfem_grid_desc desc = dgfem_default_grid_desc();
    dgfem_mesh *mesh = NULL;
    desc.upper = vec(nx, ny, nz);
    desc.cells[0] = nx, desc.cells[1] = ny, desc.cells[2] = nz;
    check_status(dgfem_mesh_create_grid(&desc, &mesh), DGFEM_OK);
    return mesh;
}

static int split(dgfem_mesh *mesh, dgfem_plane plane, double snap) {
    int count = -1;
    check_status(dgfem_mesh_split_plane(mesh, plane, (dgfem_real)snap, &count), DGFEM_OK);
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    return count;
}

/* The only face between two elements. */
static const dgfem_face *cap_of(const dgfem_mesh *mesh, int loops) {
    const dgfem_face *cap = NULL;
    for (int f = 0; f < mesh->face_count; f++) {
        if (mesh->faces[f].element[1] == DGFEM_NONE) continue;
        assert_null(cap);
        cap = &mesh->faces[f];
    }
    assert_non_null(cap);
    assert_int_equal(cap->loop_count, loops);
    assert_int_equal(cap->tag, DGFEM_NONE);
    assert_int_equal(cap->cut, 0);
    return cap;
}

/* ---- known answers ---- */

static void cube_in_two(void **state) {
    (void)state;
    dgfem_mesh *mesh = grid_of(1, 1, 1);
    mesh->elements[0].tag = 7;
    mesh->faces[0].cut = mesh->faces[1].cut = mesh->faces[2].cut = 1; /* whichever sides these are */
    assert_int_equal(split(mesh, plane_at(0, 0, 2, 0.5), 0), 1);
    assert_int_equal(mesh->element_count, 2);
    assert_int_equal(mesh->face_count, 11);
    assert_int_equal(mesh->vertex_count, 12);
    check_near(mesh->elements[0].volume, 0.25, 4 * CHECK_EPSILON); /* the first child is below */
    check_near(mesh->elements[1].volume, 0.75, 4 * CHECK_EPSILON);
    int tags[6] = {0}, cuts = 0;
    for (int e = 0; e < 2; e++) assert_int_equal(mesh->elements[e].tag, 7);
    for (int f = 0; f < 11; f++) {
        const dgfem_face *face = &mesh->faces[f];
        cuts += face->cut;
        if (face->tag != DGFEM_NONE) {
            tags[face->tag]++;
            continue;
        }
        assert_int_equal(face->element[0], 0);
        assert_int_equal(face->element[1], 1);
        check_near3(face->normal, vec(0, 0, 1), 0);
        check_near3(face->centre, vec(0.5, 0.5, 0.25), 2 * CHECK_EPSILON);
        check_near(face->area, 1, 4 * CHECK_EPSILON);
    }
    for (int side = 0; side < 6; side++) assert_int_equal(tags[side], side < 4 ? 2 : 1);
    assert_in_range(cuts, 4, 6);
    dgfem_mesh_destroy(mesh);
}

/* Every corner, edge and diagonal of a 2 x 2 x 2 grid may lie in the plane. */
static void planes_through_vertices(void **state) {
    (void)state;
    static const struct {
        int n[3], offset, elements, faces;
    } cases[] = {
        {{1, 0, 0}, 1, 8, 36},  /* between the cells */
        {{1, 0, 0}, 0, 8, 36},  /* a side of the box */
        {{1, 0, 0}, 2, 8, 36},
        {{1, 0, 0}, -1, 8, 36}, /* beside it */
        {{1, 1, 0}, 2, 12, 46}, /* diagonals of four cells: four caps, and six squares in two */
        {{1, 1, 1}, 3, 14, 54}, /* six cells lose a corner: six caps, and twelve squares in two */
        {{1, 1, 1}, 1, 9, 40},  /* one cell does: a cap, three squares */
        {{1, 1, 1}, 0, 8, 36},  /* touches a corner */
    };
    for (size_t k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        dgfem_mesh *mesh = grid_of(2, 2, 2);
        dgfem_plane plane = plane_at(cases[k].n[0], cases[k].n[1], cases[k].n[2], cases[k].offset);
        assert_int_equal(split(mesh, plane, 0), cases[k].elements - 8);
        assert_int_equal(mesh->element_count, cases[k].elements);
        assert_int_equal(mesh->face_count, cases[k].faces);
        assert_int_equal(mesh->vertex_count, 27); /* no new ones */
        check_near(dgfem_mesh_volume(mesh), 8, 100 * CHECK_EPSILON);
        check_near(dgfem_mesh_boundary_area(mesh), 24, 100 * CHECK_EPSILON);
        assert_int_equal(split(mesh, plane, 0), 0);
        plane.normal = vec(-cases[k].n[0], -cases[k].n[1], -cases[k].n[2]), plane.offset = -plane.offset;
        assert_int_equal(split(mesh, plane, 0), 0);
        dgfem_mesh_destroy(mesh);
    }
}

/* A U, its arms upwards. */
static void make_u(shape *s) {
    static const double xy[] = {0, 0, 3, 0, 3, 3, 2, 3, 2, 1, 1, 1, 1, 3, 0, 3};
    static const int loops[] = {0, 8};
    shape_prism(s, xy, loops, 1, 0, 1);
}

static void u_across_both_arms(void **state) {
    (void)state;
    dgfem_polyhedron *u, *below, *above;
    make_u(&solid);
    u = shape_polyhedron(&solid);
    check_status(dgfem_polyhedron_split(u, plane_at(0, 1, 0, 2), &below, &above), DGFEM_OK);
    assert_int_equal(components_of(below), 1);
    assert_int_equal(components_of(above), 2);
    check_near(volume_of(below), 5, 20 * CHECK_EPSILON);
    check_near(volume_of(above), 2, 20 * CHECK_EPSILON);
    check_status(dgfem_polyhedron_check(below, (dgfem_real)(100 * CHECK_EPSILON)), DGFEM_OK);
    check_status(dgfem_polyhedron_check(above, (dgfem_real)(100 * CHECK_EPSILON)), DGFEM_OK);
    dgfem_polyhedron_destroy(below);
    dgfem_polyhedron_destroy(above);
    dgfem_polyhedron_destroy(u);

    dgfem_mesh *mesh = mesh_of(&solid);
    assert_int_equal(split(mesh, plane_at(0, 1, 0, 2), 0), 1);
    assert_int_equal(mesh->element_count, 3);
    check_near(mesh->elements[0].volume, 5, 20 * CHECK_EPSILON);
    check_near(mesh->elements[1].volume, 1, 20 * CHECK_EPSILON);
    check_near(mesh->elements[2].volume, 1, 20 * CHECK_EPSILON);
    dgfem_mesh_destroy(mesh);

    mesh = mesh_of(&solid); /* along the floor between the arms: its two edges and its face lie in the plane */
    assert_int_equal(split(mesh, plane_at(0, 1, 0, 1), 0), 1);
    assert_int_equal(mesh->element_count, 3);
    check_near(mesh->elements[0].volume, 3, 20 * CHECK_EPSILON);
    dgfem_mesh_destroy(mesh);

    mesh = mesh_of(&solid); /* the same, the other way up: the floor is now a ceiling */
    assert_int_equal(split(mesh, plane_at(0, -1, 0, -1), 0), 1);
    assert_int_equal(mesh->element_count, 3);
    dgfem_mesh_destroy(mesh);

    mesh = mesh_of(&solid); /* along the inner side of an arm */
    assert_int_equal(split(mesh, plane_at(1, 0, 0, 1), 0), 1);
    assert_int_equal(mesh->element_count, 2);
    check_near(mesh->elements[0].volume, 3, 20 * CHECK_EPSILON);
    dgfem_mesh_destroy(mesh);
}

/* Two towers on a slab. At the height of the lower one its roof is no cap, and nothing above it is flat. */
static void roof_in_the_plane(void **state) {
    (void)state;
    static const double xy[] = {0, 0, 5, 0, 5, 1, 4, 1, 4, 3, 3, 3, 3, 1, 2, 1, 2, 2, 1, 2, 1, 1, 0, 1};
    static const int loops[] = {0, 12};
    shape_prism(&solid, xy, loops, 1, 0, 1);
    dgfem_mesh *mesh = mesh_of(&solid);
    assert_int_equal(split(mesh, plane_at(0, 1, 0, 2), 0), 1);
    assert_int_equal(mesh->element_count, 2);
    check_near(cap_of(mesh, 1)->area, 1, 20 * CHECK_EPSILON);
    check_near(mesh->elements[0].volume, 7, 50 * CHECK_EPSILON);
    dgfem_mesh_destroy(mesh);
    mesh = mesh_of(&solid); /* upside down: the roof is a floor */
    assert_int_equal(split(mesh, plane_at(0, -1, 0, -2), 0), 1);
    assert_int_equal(mesh->element_count, 2);
    check_near(mesh->elements[1].volume, 7, 50 * CHECK_EPSILON);
    dgfem_mesh_destroy(mesh);
}

/* A ridge, a notch and a vertex that only touch the plane, among parts that cross it. */
static void edges_that_touch(void **state) {
    (void)state;
    /* from the left: a peak at height 2, a valley at height 2, towers at 3; the slab at 0 */
    static const double xy[] = {0, 0, 9, 0, 9, 3, 8, 3, 7, 2, 6, 3, 5, 3, 5, 1, 4, 1, 3, 2, 2, 1, 0, 1};
    static const int loops[] = {0, 12};
    shape_prism(&solid, xy, loops, 1, 0, 1);
    for (int side = -1; side < 2; side += 2) {
        dgfem_mesh *mesh = mesh_of(&solid);
        double volume = (double)dgfem_mesh_volume(mesh);
        assert_int_equal(split(mesh, plane_at(0, side, 0, 2 * side), 0), 1);
        check_near(dgfem_mesh_volume(mesh), volume, 100 * CHECK_EPSILON);
        assert_int_equal(mesh->element_count, 2); /* the towers above still touch along the valley's bottom */
        check_near(cap_of(mesh, 1)->area, 4, 50 * CHECK_EPSILON);
        for (int e = 0; e < 2; e++)
            check_near(mesh->elements[e].volume, mesh->elements[e].centre.y > 2 ? 3 : volume - 3, 100 * CHECK_EPSILON);
        dgfem_mesh_destroy(mesh);
    }
}

static void torus_in_half(void **state) {
    (void)state;
    dgfem_polyhedron *torus, *below, *above;
    shape_torus(&solid, 20, 10);
    torus = shape_polyhedron(&solid);
    double volume = volume_of(torus);
    for (int k = 0; k < 3; k++) {
        /* across the axis: rings with an annulus each; along it: bent tubes with two discs; off it: one disc, split */
        dgfem_plane plane = k == 0 ? plane_at(0, 0, 1, 0.01) : k == 1 ? plane_at(1, 0.3, 0, 0.01) : plane_at(1, 0.3, 0, 3);
        check_status(dgfem_polyhedron_split(torus, plane, &below, &above), DGFEM_OK);
        assert_int_equal(components_of(below), 1);
        assert_int_equal(components_of(above), 1);
        check_near(volume_of(below) + volume_of(above), volume, 1000 * CHECK_EPSILON * volume);
        dgfem_polyhedron *parts[2] = {below, above};
        for (int i = 0; i < 2; i++) {
            int holes = 0;
            check_status(dgfem_polyhedron_check(parts[i], (dgfem_real)(100 * CHECK_EPSILON)), DGFEM_OK);
            for (int f = 0; f < parts[i]->face_count; f++)
                holes += parts[i]->face_loops[f + 1] - parts[i]->face_loops[f] - 1;
            assert_int_equal(holes, k == 0 ? 1 : 0);
            dgfem_polyhedron_destroy(parts[i]);
        }
    }
    dgfem_polyhedron_destroy(torus);
}

/* The box 0..4 around the void 1..3. */
static void enclosed_void(void **state) {
    (void)state;
    shape_hollow_box(&solid, &scratch);
    dgfem_mesh *mesh = mesh_of(&solid);
    assert_int_equal(split(mesh, plane_at(1, 0, 0, 2), 0), 1); /* through the void: the cap has a hole */
    const dgfem_face *cap = cap_of(mesh, 2);
    check_near(cap->area, 12, 100 * CHECK_EPSILON);
    check_near3(cap->centre, vec(2, 2, 2), 20 * CHECK_EPSILON);
    check_near(mesh->elements[0].volume, 28, 100 * CHECK_EPSILON);
    dgfem_mesh_destroy(mesh);

    mesh = mesh_of(&solid); /* beside it: the void stays with the larger part */
    assert_int_equal(split(mesh, plane_at(1, 0, 0, 0.5), 0), 1);
    assert_int_equal(mesh->element_count, 2);
    check_near(cap_of(mesh, 1)->area, 16, 100 * CHECK_EPSILON);
    check_near(mesh->elements[0].volume, 8, 100 * CHECK_EPSILON);
    check_near(mesh->elements[1].volume, 48, 200 * CHECK_EPSILON);
    assert_int_equal(mesh->elements[1].face_count, 12);
    dgfem_mesh_destroy(mesh);

    mesh = mesh_of(&solid); /* along its side: a face of the void is in the plane */
    assert_int_equal(split(mesh, plane_at(1, 0, 0, 1), 0), 1);
    check_near(cap_of(mesh, 2)->area, 12, 100 * CHECK_EPSILON);
    check_near(mesh->elements[0].volume, 16, 100 * CHECK_EPSILON);
    dgfem_mesh_destroy(mesh);
}

/* Nested boxes: solid, void, solid in the void, void in that. Several voids and several hosts on one side. */
static void voids_find_their_hosts(void **state) {
    (void)state;
    dgfem_polyhedron *p, *below, *above;
    shape_box(&solid, 0, 0, 0, 20, 10, 10);
    shape_box(&scratch, 1, 1, 1, 9, 9, 9), shape_reverse(&scratch), shape_append(&solid, &scratch);
    shape_box(&scratch, 3, 3, 3, 7, 7, 7), shape_append(&solid, &scratch);
    shape_box(&scratch, 4, 4, 4, 6, 6, 6), shape_reverse(&scratch), shape_append(&solid, &scratch);
    shape_box(&scratch, 12, 2, 2, 13, 3, 3), shape_reverse(&scratch), shape_append(&solid, &scratch);
    p = shape_polyhedron(&solid);
    check_status(dgfem_polyhedron_split(p, plane_at(1, 0, 0, 15), &below, &above), DGFEM_OK);
    check_near(volume_of(below), 1500 - 512 + 64 - 8 - 1, 4000 * CHECK_EPSILON);
    check_near(volume_of(above), 500, 4000 * CHECK_EPSILON);
    assert_int_equal(components_of(below), 2);
    dgfem_polyhedron_destroy(below);
    dgfem_polyhedron_destroy(above);
    check_status(dgfem_polyhedron_split(p, plane_at(0, 0, 1, 5), &below, &above), DGFEM_OK);
    assert_int_equal(components_of(below), 2); /* the caps: two annuli, and a hole that is a dent */
    check_status(dgfem_polyhedron_check(below, (dgfem_real)(100 * CHECK_EPSILON)), DGFEM_OK);
    check_near(volume_of(below), 1000 - 256 + 32 - 4 - 1, 4000 * CHECK_EPSILON);
    dgfem_polyhedron_destroy(below);
    dgfem_polyhedron_destroy(above);
    dgfem_polyhedron_destroy(p);
}

static void all_on_one_side(void **state) {
    (void)state;
    dgfem_polyhedron *box, *below, *above;
    shape_box(&solid, 0, 0, 0, 1, 1, 1);
    box = shape_polyhedron(&solid);
    for (int k = 0; k < 4; k++) { /* beside and along a face, on either side; on the plane alone is no part */
        static const double offsets[] = {-1, 0, 1, 2};
        check_status(dgfem_polyhedron_split(box, plane_at(0, 0, 1, offsets[k]), &below, &above), DGFEM_OK);
        assert_true((below == NULL) == (k < 2));
        assert_true((above == NULL) == (k >= 2));
        check_near(volume_of(below ? below : above), 1, 20 * CHECK_EPSILON);
        dgfem_polyhedron_destroy(below);
        dgfem_polyhedron_destroy(above);
    }
    dgfem_polyhedron_destroy(box);
}

/* ---- random solids and planes ---- */

typedef void (*make_fn)(shape *s);
static void make_hollow(shape *s) { shape_hollow_box(s, &scratch); }
static void make_ring(shape *s) { shape_torus(s, 12, 7); }
static void make_box(shape *s) { shape_box(s, -1, -2, -3, 2, 3, 1); }
static const make_fn makers[] = {make_box,         shape_tetrahedron, shape_cut_cube, shape_truncated_octahedron,
                                 shape_star_prism, make_u,            make_ring,      shape_plate,
                                 shape_bracket,    make_hollow};

/* Turns and stretches, and moves away from the origin. */
static void transform(shape *s, check_random *random) {
    double m[3][3], t[3];
    for (;;) {
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) m[i][j] = check_random_real(random, -1, 1);
        double det = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                     m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
        if (det > 0.3) break;
    }
    for (int i = 0; i < 3; i++) t[i] = check_random_real(random, -3, 3);
    shape_transform(s, (const double (*)[3])m, t);
}

static dgfem_plane random_plane(check_random *random, dgfem_measure box) {
    dgfem_vec3 n = check_random_vec3(random, -1, 1), p;
    double x = check_random_real(random, 0.05, 0.95), y = check_random_real(random, 0.05, 0.95);
    double z = check_random_real(random, 0.05, 0.95);
    p = vec((double)box.lower.x + x * (double)(box.upper.x - box.lower.x),
            (double)box.lower.y + y * (double)(box.upper.y - box.lower.y),
            (double)box.lower.z + z * (double)(box.upper.z - box.lower.z));
    return plane_at((double)n.x, (double)n.y, (double)n.z, dot3(n, p));
}

/* The volume is kept, both parts are sound, and a point is in a part when it is in the whole and on its side. */
static void random_polyhedra(void **state) {
    (void)state;
    check_random random = check_random_seeded(5);
    int rounds = check_long() ? 400 : 20;
    for (int round = 0; round < rounds; round++)
        for (size_t k = 0; k < sizeof makers / sizeof makers[0]; k++) {
            dgfem_polyhedron *p, *below, *above;
            makers[k](&solid);
            transform(&solid, &random);
            p = shape_polyhedron(&solid);
            dgfem_measure whole = dgfem_polyhedron_measure(p);
            dgfem_plane plane = random_plane(&random, whole);
            check_status(dgfem_polyhedron_split(p, plane, &below, &above), DGFEM_OK);
            check_near((volume_of(below) + volume_of(above)) / (double)whole.volume, 1, 450 * CHECK_EPSILON); /* 1e-13 */
            if (below) check_status(dgfem_polyhedron_check(below, (dgfem_real)(1000 * CHECK_EPSILON)), DGFEM_OK);
            if (above) check_status(dgfem_polyhedron_check(above, (dgfem_real)(1000 * CHECK_EPSILON)), DGFEM_OK);
            for (int i = 0; i < 40; i++) {
                dgfem_vec3 q = vec(check_random_real(&random, (double)whole.lower.x, (double)whole.upper.x),
                                   check_random_real(&random, (double)whole.lower.y, (double)whole.upper.y),
                                   check_random_real(&random, (double)whole.lower.z, (double)whole.upper.z));
                double side = dot3(plane.normal, q) - (double)plane.offset;
                int inside = dgfem_polyhedron_contains(p, q);
                if (fabs(side) < 1e4 * CHECK_EPSILON) continue;
                assert_int_equal(below ? dgfem_polyhedron_contains(below, q) : 0, inside && side < 0);
                assert_int_equal(above ? dgfem_polyhedron_contains(above, q) : 0, inside && side > 0);
            }
            dgfem_polyhedron_destroy(below);
            dgfem_polyhedron_destroy(above);
            dgfem_polyhedron_destroy(p);
        }
}

/* Several planes through one mesh; each again splits nothing. */
static void random_meshes(void **state) {
    (void)state;
    check_random random = check_random_seeded(6);
    int rounds = check_long() ? 200 : 6;
    for (int round = 0; round < rounds; round++)
        for (size_t k = 0; k < sizeof makers / sizeof makers[0]; k++) {
            dgfem_polyhedron *p;
            makers[k](&solid);
            transform(&solid, &random);
            p = shape_polyhedron(&solid);
            dgfem_mesh *mesh = mesh_of(&solid);
            double volume = (double)dgfem_mesh_volume(mesh), area = (double)dgfem_mesh_boundary_area(mesh);
            for (int i = 0; i < 4; i++) {
                dgfem_plane plane = random_plane(&random, dgfem_polyhedron_measure(p));
                split(mesh, plane, 0);
                check_near((double)dgfem_mesh_volume(mesh) / volume, 1, 450 * CHECK_EPSILON);
                check_near((double)dgfem_mesh_boundary_area(mesh) / area, 1, 450 * CHECK_EPSILON);
                assert_int_equal(split(mesh, plane, 0), 0);
            }
            dgfem_mesh_destroy(mesh);
            dgfem_polyhedron_destroy(p);
        }
}

/* ---- unit cubes on the lattice, planes through its points: everything degenerate, volumes known exactly ---- */

enum { CUBES = 3, LATTICE = CUBES + 3 };

typedef struct cubes {
    int filled[CUBES + 2][CUBES + 2][CUBES + 2];
    int count, vertex_of[LATTICE * LATTICE * LATTICE];
    dgfem_vec3 vertices[LATTICE * LATTICE * LATTICE];
    int triangles[3 * 12 * CUBES * CUBES * CUBES];
    int vertex_count, triangle_count;
} cubes;

static int cube_vertex(cubes *c, int i, int j, int k) {
    int *v = &c->vertex_of[i + LATTICE * (j + LATTICE * k)];
    if (*v < 0) {
        *v = c->vertex_count++;
        c->vertices[*v] = vec(i, j, k);
    }
    return *v;
}

/* The side of a cube across an axis, upper or lower, along either diagonal. */
static void cube_side(cubes *c, const int at[3], int axis, int upper, int diagonal) {
    int v[4], *t = c->triangles + 3 * c->triangle_count;
    for (int corner = 0; corner < 4; corner++) {
        int p[3] = {at[0], at[1], at[2]}, turned = upper ? corner : 3 - corner;
        p[axis] += upper;
        p[(axis + 1) % 3] += turned == 1 || turned == 2;
        p[(axis + 2) % 3] += turned >= 2;
        v[corner] = cube_vertex(c, p[0], p[1], p[2]);
    }
    t[0] = v[diagonal], t[1] = v[diagonal + 1], t[2] = v[diagonal + 2];
    t[3] = v[diagonal], t[4] = v[diagonal + 2], t[5] = v[(diagonal + 3) % 4];
    c->triangle_count += 2;
}

static void random_cubes(cubes *c, check_random *random) {
    int fill = 20 + check_random_int(random, 75);
    memset(c, 0, sizeof *c);
    for (int i = 0; i < LATTICE * LATTICE * LATTICE; i++) c->vertex_of[i] = -1;
    while (c->count == 0)
        for (int i = 1; i <= CUBES; i++)
            for (int j = 1; j <= CUBES; j++)
                for (int k = 1; k <= CUBES; k++)
                    if (!c->filled[i][j][k]) c->count += c->filled[i][j][k] = check_random_int(random, 100) < fill;
    for (int i = 1; i <= CUBES; i++)
        for (int j = 1; j <= CUBES; j++)
            for (int k = 1; k <= CUBES; k++)
                for (int side = 0; side < 6 && c->filled[i][j][k]; side++) {
                    int at[3] = {i, j, k}, next[3] = {i, j, k};
                    next[side / 2] += side % 2 ? 1 : -1;
                    if (!c->filled[next[0]][next[1]][next[2]])
                        cube_side(c, at, side / 2, side % 2, check_random_int(random, 2));
                }
}

static dgfem_mesh *cubes_mesh(const cubes *c) {
    dgfem_slice_desc desc = dgfem_default_slice_desc();
    dgfem_mesh *mesh = NULL;
    desc.vertices = dgfem_points_in_vec3(c->vertices, c->vertex_count);
    desc.triangles = c->triangles, desc.triangle_count = c->triangle_count;
    desc.cells = 1;
    desc.sliver = 0;
    check_status(dgfem_mesh_create_slices(&desc, &mesh), DGFEM_OK);
    return mesh;
}

/* Volume of the unit cube at `at` below the plane n.x = offset: inclusion and exclusion of its corners. */
static double cube_below(const int at[3], const int n[3], double offset) {
    double slopes[3], factor = 1, sum = 0;
    int count = 0;
    offset -= n[0] * at[0] + n[1] * at[1] + n[2] * at[2];
    for (int i = 0; i < 3; i++) {
        if (n[i] < 0) offset -= n[i];
        if (n[i] != 0) slopes[count++] = abs(n[i]);
    }
    for (int i = 0; i < count; i++) factor *= slopes[i] * (i + 1);
    for (int corner = 0; corner < 1 << count; corner++) {
        double rest = offset, sign = 1;
        for (int i = 0; i < count; i++)
            if (corner >> i & 1) rest -= slopes[i], sign = -sign;
        if (rest > 0) sum += sign * pow(rest, count);
    }
    return sum / factor;
}

static double cubes_below(const cubes *c, const int n[3], double offset) {
    double sum = 0;
    for (int i = 1; i <= CUBES; i++)
        for (int j = 1; j <= CUBES; j++)
            for (int k = 1; k <= CUBES; k++) {
                int at[3] = {i, j, k};
                if (c->filled[i][j][k]) sum += cube_below(at, n, offset);
            }
    return sum;
}

static double mesh_below(const dgfem_mesh *mesh, const int n[3], double offset) {
    double sum = 0;
    for (int e = 0; e < mesh->element_count; e++)
        if (dot3(vec(n[0], n[1], n[2]), mesh->elements[e].centre) < offset) sum += (double)mesh->elements[e].volume;
    return sum;
}

static void random_cubes_on_the_lattice(void **state) {
    (void)state;
    check_random random = check_random_seeded(7);
    int rounds = check_long() ? 4000 : 120;
    static cubes c;
    for (int round = 0; round < rounds; round++) {
        random_cubes(&c, &random);
        dgfem_mesh *mesh = cubes_mesh(&c);
        for (int i = 0; i < 5; i++) {
            int n[3];
            do
                for (int k = 0; k < 3; k++) n[k] = check_random_int(&random, 5) - 2;
            while (n[0] == 0 && n[1] == 0 && n[2] == 0);
            double offset = 0, length = sqrt((double)(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]));
            for (int k = 0; k < 3; k++) offset += n[k] * (1 + check_random_int(&random, CUBES + 1));
            if (check_random_int(&random, 3) == 0) offset += 0.5;
            if (check_random_int(&random, 4) == 0) offset += 0.01 * check_random_int(&random, 100);
            if (check_random_int(&random, 2)) length = 1; /* both unit and other normals */
            dgfem_plane plane = plane_at(n[0] / length, n[1] / length, n[2] / length, offset / length);
            split(mesh, plane, 0);
            check_near(dgfem_mesh_volume(mesh), c.count, 2000 * CHECK_EPSILON * c.count);
            check_near(mesh_below(mesh, n, offset), cubes_below(&c, n, offset), 5000 * CHECK_EPSILON * c.count);
            assert_int_equal(split(mesh, plane, 0), 0);
        }
        dgfem_mesh_destroy(mesh);
    }
}

/* ---- snapping ---- */

/* Stored areas times normals cancel exactly only if every face is planar. */
static double largest_gap(const dgfem_mesh *mesh) {
    double largest = 0;
    for (int e = 0; e < mesh->element_count; e++) {
        double sum[3] = {0, 0, 0};
        for (int k = 0; k < mesh->elements[e].face_count; k++) {
            const dgfem_face *face = &mesh->faces[mesh->element_faces[mesh->elements[e].face_start + k]];
            double area = (face->element[0] == e ? 1 : -1) * (double)face->area;
            sum[0] += area * (double)face->normal.x;
            sum[1] += area * (double)face->normal.y;
            sum[2] += area * (double)face->normal.z;
        }
        for (int i = 0; i < 3; i++) largest = fmax(largest, fabs(sum[i]));
    }
    return largest;
}

static double smallest_volume(const dgfem_mesh *mesh) {
    double smallest = INFINITY;
    for (int e = 0; e < mesh->element_count; e++) smallest = fmin(smallest, (double)mesh->elements[e].volume);
    return smallest;
}

static void snapping_avoids_slivers(void **state) {
    (void)state;
    dgfem_plane plane = plane_at(1, 1, 1, 3.001); /* passes close to seven vertices of the grid */
    dgfem_mesh *exact = grid_of(2, 2, 2), *snapped = grid_of(2, 2, 2);
    split(exact, plane, 0);
    assert_int_equal(split(snapped, plane, 1e-2), 6);
    assert_int_equal(snapped->element_count, 14);
    assert_true(smallest_volume(exact) < 1e-3);
    assert_true(smallest_volume(snapped) > 0.1);
    check_near(dgfem_mesh_volume(snapped), 8, 100 * CHECK_EPSILON);
    check_near(largest_gap(snapped), 0, 20 * CHECK_EPSILON);
    dgfem_mesh_destroy(exact);
    dgfem_mesh_destroy(snapped);

    exact = grid_of(2, 2, 2); /* close to a face: nothing is split at all */
    assert_int_equal(split(exact, plane_at(1, 0, 0, 1.001), 1e-2), 0);
    assert_int_equal(split(exact, plane_at(1, 0, 0, 1.001), 1e-4), 4);
    dgfem_mesh_destroy(exact);
}

static void snapping_keeps_faces_planar(void **state) {
    (void)state;
    check_random random = check_random_seeded(8);
    int rounds = check_long() ? 500 : 30;
    for (int round = 0; round < rounds; round++) {
        dgfem_mesh *mesh = grid_of(3, 2, 2);
        for (int i = 0; i < 4; i++) {
            dgfem_plane plane = plane_at(0, 0, 0, 0);
            plane.normal = check_random_vec3(&random, -1, 1);
            plane.offset = (dgfem_real)dot3(plane.normal, vec(1.5, 1, 1));
            split(mesh, plane, 0.1);
            check_near(dgfem_mesh_volume(mesh), 12, 1000 * CHECK_EPSILON);
            check_near(largest_gap(mesh), 0, 200 * CHECK_EPSILON);
        }
        dgfem_mesh_destroy(mesh);
    }
}

/* Solids that do not take snapping well are split all the same, or refused unchanged where an earlier cut that was bent
   by snapping has left them crooked. */
static void snapping_survives_bad_shapes(void **state) {
    (void)state;
    check_random random = check_random_seeded(9);
    int rounds = check_long() ? 1000 : 40, refused = 0;
    static cubes c;
    for (int round = 0; round < rounds; round++) {
        random_cubes(&c, &random);
        dgfem_mesh *mesh = cubes_mesh(&c);
        for (int i = 0; i < 4; i++) {
            dgfem_plane plane = plane_at(0, 0, 0, 0);
            plane.normal = check_random_vec3(&random, -1, 1);
            plane.offset = (dgfem_real)(dot3(plane.normal, vec(2, 2, 3)) + check_random_real(&random, -0.05, 0.05));
            dgfem_status status = dgfem_mesh_split_plane(mesh, plane, DGFEM_R(0.1), NULL);
            if (status) check_status(status, DGFEM_ERROR_DEGENERATE);
            refused += status != DGFEM_OK;
            check_status(dgfem_mesh_check(mesh), DGFEM_OK);
            check_near(dgfem_mesh_volume(mesh), c.count, 2000 * CHECK_EPSILON * c.count);
        }
        dgfem_mesh_destroy(mesh);
    }
    assert_true(refused * 200 <= rounds);
}

/* ---- a part of the mesh ---- */

static int element_has_vertex_at(const dgfem_mesh *mesh, int e, dgfem_vec3 p) {
    for (int k = 0; k < mesh->elements[e].face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[mesh->elements[e].face_start + k]];
        for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            for (int i = 0; i < mesh->loops[l].count; i++) {
                dgfem_vec3 d = dgfemi_sub(mesh->vertices[mesh->loop_vertices[mesh->loops[l].start + i]], p);
                if (dgfemi_norm(d) <= (dgfem_real)(10 * CHECK_EPSILON)) return 1;
            }
    }
    return 0;
}

/* One cell of 2 x 2 x 2 is split. Its new vertices enter all cells around their edges, also the one that touches the
   split cell along an edge alone; the mesh stays closed everywhere. */
static void one_element_of_many(void **state) {
    (void)state;
    dgfem_mesh *mesh = grid_of(2, 2, 2);
    dgfemi_splitter s = dgfemi_splitter_make(mesh);
    int element = 0;
    s.components = s.measure = 1;
    check_status(dgfemi_split_elements(&s, plane_at(0, 0, 1, 0.25), &element, 1), DGFEM_OK);
    assert_int_equal(s.selected.count, 1);
    assert_int_equal(s.children[0].parent, 0);
    assert_int_equal(s.children[0].element, 0);
    assert_int_equal(s.children[0].side, -1);
    assert_int_equal(s.children[1].element, 8);
    assert_int_equal(s.children[1].side, 1);
    dgfemi_splitter_free(&s);
    check_status(dgfemi_mesh_compact(mesh), DGFEM_OK);
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    assert_int_equal(mesh->element_count, 9);
    check_near(mesh->elements[0].volume, 0.25, 10 * CHECK_EPSILON);
    check_near(mesh->elements[8].volume, 0.75, 10 * CHECK_EPSILON);
    check_near(dgfem_mesh_volume(mesh), 8, 100 * CHECK_EPSILON);
    for (int e = 0; e < 4; e++) assert_true(element_has_vertex_at(mesh, e, vec(1, 1, 0.25))); /* 3 only touches */
    for (int e = 4; e < 8; e++) assert_false(element_has_vertex_at(mesh, e, vec(1, 1, 0.25)));
    assert_int_equal(mesh->elements[1].face_count, 7); /* the face towards the split cell is two now */
    assert_int_equal(mesh->elements[3].face_count, 6);
    dgfem_mesh_destroy(mesh);
}

static void random_parts_of_meshes(void **state) {
    (void)state;
    check_random random = check_random_seeded(10);
    int rounds = check_long() ? 500 : 25;
    for (int round = 0; round < rounds; round++) {
        dgfem_mesh *mesh = grid_of(3, 2, 2);
        dgfemi_splitter s = dgfemi_splitter_make(mesh);
        s.components = s.measure = 1;
        s.snap = round % 2 ? (dgfem_real)0.05 : 0;
        for (int i = 0; i < 8; i++) {
            int list[64], count = 0;
            dgfem_plane plane = plane_at(0, 0, 0, 0);
            plane.normal = check_random_vec3(&random, -1, 1);
            plane.offset = (dgfem_real)dot3(plane.normal, check_random_vec3(&random, 0.5, 2));
            for (int e = 0; e < mesh->element_count && count < 64; e++)
                if (check_random_int(&random, 2)) list[count++] = e;
            check_status(dgfemi_split_elements(&s, plane, list, count), DGFEM_OK);
            check_status(dgfemi_mesh_compact(mesh), DGFEM_OK);
            check_status(dgfem_mesh_check(mesh), DGFEM_OK);
            check_near(dgfem_mesh_volume(mesh), 12, 500 * CHECK_EPSILON);
        }
        dgfemi_splitter_free(&s);
        dgfem_mesh_destroy(mesh);
    }
}

/* ---- failures ---- */

static void bad_calls(void **state) {
    (void)state;
    check_host host;
    dgfem_polyhedron *box, *below = NULL, *above = NULL;
    dgfem_plane good = plane_at(0, 0, 1, 0.5);
    shape_box(&solid, 0, 0, 0, 1, 1, 1);
    dgfem_polyhedron_desc desc = shape_desc(&solid);
    desc.hooks = check_hooks(&host);
    check_status(dgfem_polyhedron_create(&desc, &box), DGFEM_OK);
    check_status(dgfem_polyhedron_split(NULL, good, &below, &above), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_polyhedron_split(box, good, NULL, &above), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_polyhedron_split(box, good, &below, NULL), DGFEM_ERROR_ARGUMENT);
    host.log_count = 0;
    check_status(dgfem_polyhedron_split(box, plane_at(0, 0, 0, 0.5), &below, &above), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "normal");
    check_status(dgfem_polyhedron_split(box, plane_at(0, NAN, 0, 0.5), &below, &above), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "plane");
    check_status(dgfem_polyhedron_split(box, plane_at(0, 1, 0, INFINITY), &below, &above), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "plane");
    assert_null(below);
    assert_null(above);
    box->face_count--; /* a side is missing */
    check_status(dgfem_polyhedron_split(box, good, &below, &above), DGFEM_ERROR_OPEN);
    check_logged(&host, "edge from vertex");
    box->face_count++;
    dgfem_polyhedron_destroy(box);

    dgfem_grid_desc grid = dgfem_default_grid_desc();
    dgfem_mesh *mesh;
    int count = 5;
    grid.hooks = desc.hooks;
    check_status(dgfem_mesh_create_grid(&grid, &mesh), DGFEM_OK);
    check_status(dgfem_mesh_split_plane(NULL, good, 0, &count), DGFEM_ERROR_ARGUMENT);
    assert_int_equal(count, 0);
    check_status(dgfem_mesh_split_plane(mesh, plane_at(0, 0, 0, 0), 0, &count), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "normal");
    check_status(dgfem_mesh_split_plane(mesh, plane_at(NAN, 0, 0, 0), 0, &count), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "plane");
    static const double snaps[] = {-0.1, 1, NAN};
    for (int k = 0; k < 3; k++) {
        check_status(dgfem_mesh_split_plane(mesh, good, (dgfem_real)snaps[k], &count), DGFEM_ERROR_ARGUMENT);
        check_logged(&host, "snap");
    }
    check_status(dgfem_mesh_split_plane(mesh, good, 0, NULL), DGFEM_OK);
    dgfem_mesh_destroy(mesh);
    assert_int_equal(host.live, 0);
}

static dgfem_status split_polyhedron_with(void *context, const dgfem_hooks *hooks) {
    dgfem_polyhedron *p, *below = NULL, *above = NULL;
    dgfem_polyhedron_desc desc = shape_desc((const shape *)context);
    desc.hooks = *hooks;
    dgfem_status status = dgfem_polyhedron_create(&desc, &p);
    if (status) return status;
    status = dgfem_polyhedron_split(p, plane_at(1, 0.2, 0.1, 2.2), &below, &above);
    assert_true(status ? !below && !above : below && above);
    dgfem_polyhedron_destroy(below);
    dgfem_polyhedron_destroy(above);
    dgfem_polyhedron_destroy(p);
    return status;
}

/* The bytes that make up a mesh. */
static uint64_t fingerprint(const dgfem_mesh *mesh) {
    uint64_t hash = 1469598103934665603u;
    const void *arrays[6] = {mesh->vertices, mesh->faces,         mesh->elements,
                             mesh->loops,    mesh->loop_vertices, mesh->element_faces};
    size_t sizes[6] = {(size_t)mesh->vertex_count * sizeof(dgfem_vec3),    (size_t)mesh->face_count * sizeof(dgfem_face),
                       (size_t)mesh->element_count * sizeof(dgfem_element), (size_t)mesh->loop_count * sizeof(dgfem_loop),
                       (size_t)mesh->loop_vertex_count * sizeof(int),       (size_t)mesh->element_face_count * sizeof(int)};
    for (int k = 0; k < 6; k++)
        for (size_t i = 0; i < sizes[k]; i++) hash = (hash ^ ((const unsigned char *)arrays[k])[i]) * 1099511628211u;
    return hash;
}

typedef struct mesh_split {
    double snap;
    int part; /* 1: elements 0 and 3 alone, in place */
} mesh_split;

static dgfem_status split_mesh_with(void *context, const dgfem_hooks *hooks) {
    const mesh_split *how = (const mesh_split *)context;
    dgfem_grid_desc desc = dgfem_default_grid_desc();
    dgfem_plane plane = plane_at(1, 1, 1, 1.501);
    dgfem_mesh *mesh;
    desc.cells[0] = desc.cells[1] = desc.cells[2] = 2;
    desc.hooks = *hooks;
    dgfem_status status = dgfem_mesh_create_grid(&desc, &mesh);
    if (status) return status;
    uint64_t before = fingerprint(mesh);
    if (how->part) {
        dgfemi_splitter s = dgfemi_splitter_make(mesh);
        int list[2] = {0, 3};
        s.components = s.measure = 1;
        s.snap = (dgfem_real)how->snap;
        status = dgfemi_split_elements(&s, plane, list, 2);
        dgfemi_splitter_free(&s);
    } else {
        status = dgfem_mesh_split_plane(mesh, plane, (dgfem_real)how->snap, NULL);
    }
    assert_true((fingerprint(mesh) == before) == (status != DGFEM_OK));
    dgfem_mesh_destroy(mesh);
    return status;
}

static void every_allocation_may_fail(void **state) {
    (void)state;
    mesh_split ways[4] = {{0, 0}, {1e-2, 0}, {0, 1}, {1e-2, 1}};
    shape_hollow_box(&solid, &scratch);
    assert_true(check_every_allocation(split_polyhedron_with, &solid) > 20);
    for (int k = 0; k < 4; k++) assert_true(check_every_allocation(split_mesh_with, &ways[k]) > 15);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cube_in_two),
        cmocka_unit_test(planes_through_vertices),
        cmocka_unit_test(u_across_both_arms),
        cmocka_unit_test(roof_in_the_plane),
        cmocka_unit_test(edges_that_touch),
        cmocka_unit_test(torus_in_half),
        cmocka_unit_test(enclosed_void),
        cmocka_unit_test(voids_find_their_hosts),
        cmocka_unit_test(all_on_one_side),
        cmocka_unit_test(random_polyhedra),
        cmocka_unit_test(random_meshes),
        cmocka_unit_test(random_cubes_on_the_lattice),
        cmocka_unit_test(snapping_avoids_slivers),
        cmocka_unit_test(snapping_keeps_faces_planar),
        cmocka_unit_test(snapping_survives_bad_shapes),
        cmocka_unit_test(one_element_of_many),
        cmocka_unit_test(random_parts_of_meshes),
        cmocka_unit_test(bad_calls),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests_name("split", tests, NULL, NULL);
}
