/* The cell complex: building, checking, corners, merging. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check.h"
#include <float.h>

#define REAL_MAX (DGFEM_REAL_IS_FLOAT ? (dgfem_real)FLT_MAX : (dgfem_real)DBL_MAX)

/* ---- meshes to test on ---- */

static dgfem_vec3 at(double x, double y, double z) {
    dgfem_vec3 p;
    p.x = (dgfem_real)x, p.y = (dgfem_real)y, p.z = (dgfem_real)z;
    return p;
}

static dgfem_grid_desc box_desc(int nx, int ny, int nz, const dgfem_hooks *hooks) {
    dgfem_grid_desc desc = dgfem_default_grid_desc();
    desc.upper = at(nx, ny, nz);
    desc.cells[0] = nx, desc.cells[1] = ny, desc.cells[2] = nz;
    if (hooks) desc.hooks = *hooks;
    return desc;
}

/* Unit cubes from the origin on. */
static dgfem_mesh *box(int nx, int ny, int nz, const dgfem_hooks *hooks) {
    dgfem_grid_desc desc = box_desc(nx, ny, nz, hooks);
    dgfem_mesh *mesh = NULL;
    check_status(dgfem_mesh_create_grid(&desc, &mesh), DGFEM_OK);
    assert_non_null(mesh);
    return mesh;
}

static void remeasure(dgfem_mesh *mesh) {
    int f, e;
    for (f = 0; f < mesh->face_count; f++) mesh->faces[f].normal = dgfemi_mesh_unit_normal(mesh, f);
    for (f = 0; f < mesh->face_count; f++) dgfemi_mesh_measure_face(mesh, f);
    for (e = 0; e < mesh->element_count; e++) dgfemi_mesh_measure_element(mesh, e);
}

/* A box of cells between the given coordinates. */
static dgfem_mesh *box_of_planes(int nx, const double *x, int ny, const double *y, int nz, const double *z,
                                 const dgfem_hooks *hooks) {
    dgfem_mesh *mesh = box(nx, ny, nz, hooks);
    int v;
    for (v = 0; v < mesh->vertex_count; v++) {
        dgfem_vec3 p = mesh->vertices[v];
        mesh->vertices[v] = at(x[(int)p.x], y[(int)p.y], z[(int)p.z]);
    }
    remeasure(mesh);
    return mesh;
}

/* Cells of equal label become one element; the label of element i is labels[its tag]. */
static dgfem_mesh *labelled_box(int nx, int ny, int nz, const int *labels, const dgfem_hooks *hooks) {
    dgfem_mesh *mesh = box(nx, ny, nz, hooks);
    int cells = mesh->element_count, label, e, f, k, s;
    int *faces = (int *)malloc(6 * (size_t)cells * sizeof(int));
    int *element_of = (int *)malloc((size_t)cells * sizeof(int));
    for (e = 0; e < cells; e++) element_of[e] = DGFEM_NONE;
    for (label = 0; label < cells; label++) {
        int count = 0, tag = DGFEM_NONE;
        for (e = 0; e < cells; e++) {
            if (labels[e] != label) continue;
            if (tag == DGFEM_NONE) tag = e;
            for (k = 0; k < 6; k++) {
                const dgfem_face *face = &mesh->faces[mesh->element_faces[6 * e + k]];
                int other = face->element[face->element[0] == e];
                if (other == DGFEM_NONE || labels[other] != label) faces[count++] = mesh->element_faces[6 * e + k];
            }
            element_of[e] = mesh->element_count;
        }
        if (count > 0) assert_true(dgfemi_mesh_add_element(mesh, faces, count, tag) >= 0);
    }
    for (f = 0; f < mesh->face_count; f++) {
        dgfem_face *face = &mesh->faces[f];
        for (s = 0; s < 2; s++)
            if (face->element[s] != DGFEM_NONE) face->element[s] = element_of[face->element[s]];
        if (face->element[0] == DGFEM_NONE) { /* a cell with a negative label is left out */
            face->element[0] = face->element[1], face->element[1] = DGFEM_NONE;
            if (face->element[0] == DGFEM_NONE) continue;
            face->normal = dgfemi_scale(-1, face->normal);
            for (k = 0; k < 2; k++) {
                int *v = mesh->loop_vertices + mesh->loops[face->loop_start].start, swap = v[k];
                v[k] = v[3 - k], v[3 - k] = swap;
            }
        }
        if (face->element[0] == face->element[1]) face->element[0] = face->element[1] = DGFEM_NONE;
    }
    for (e = 0; e < cells; e++) mesh->elements[e].face_count = 0;
    free(faces);
    free(element_of);
    check_status(dgfemi_mesh_compact(mesh), DGFEM_OK);
    remeasure(mesh);
    return mesh;
}

/* Six tetrahedra per cube of an n^3 grid of the unit cube, all along the cubes' diagonals (Kuhn). */
typedef struct kuhn {
    int n, count;
    double *vertices;
    int *tetrahedra;
} kuhn;

static kuhn kuhn_make(int n) {
    static const int orders[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    kuhn k;
    int i, j, l, o, s, m = n + 1;
    k.n = n, k.count = 0;
    k.vertices = (double *)malloc(3 * (size_t)(m * m * m) * sizeof(double));
    k.tetrahedra = (int *)malloc(24 * (size_t)(n * n * n) * sizeof(int));
    for (i = 0; i < m * m * m; i++) {
        k.vertices[3 * i] = (double)(i % m) / n;
        k.vertices[3 * i + 1] = (double)(i / m % m) / n;
        k.vertices[3 * i + 2] = (double)(i / m / m) / n;
    }
    for (l = 0; l < n; l++)
        for (j = 0; j < n; j++)
            for (i = 0; i < n; i++)
                for (o = 0; o < 6; o++) {
                    int *t = k.tetrahedra + 4 * k.count++, p[3], odd = o == 1 || o == 2 || o == 5;
                    p[0] = i, p[1] = j, p[2] = l;
                    t[0] = p[0] + m * (p[1] + m * p[2]);
                    for (s = 0; s < 3; s++) {
                        p[orders[o][s]]++;
                        t[s + 1] = p[0] + m * (p[1] + m * p[2]);
                    }
                    if (odd) s = t[1], t[1] = t[2], t[2] = s;
                }
    return k;
}

static void kuhn_free(kuhn *k) {
    free(k->vertices);
    free(k->tetrahedra);
}

static dgfem_tetrahedra_desc kuhn_desc(const kuhn *k, const dgfem_hooks *hooks) {
    dgfem_tetrahedra_desc desc = dgfem_default_tetrahedra_desc();
    int m = k->n + 1;
    desc.vertices = dgfem_points_in_double(k->vertices, m * m * m);
    desc.tetrahedra = k->tetrahedra;
    desc.tetrahedron_count = k->count;
    if (hooks) desc.hooks = *hooks;
    return desc;
}

/* ---- measures of whole meshes, by other means ---- */

static int interior_faces(const dgfem_mesh *mesh) {
    int f, count = 0;
    for (f = 0; f < mesh->face_count; f++) count += mesh->faces[f].element[1] != DGFEM_NONE;
    return count;
}

static int compare_edges(const void *a, const void *b) { return memcmp(a, b, 2 * sizeof(int)); }

/* Vertices in use - edges + faces - elements: 1 for a ball. */
static int euler(const dgfem_mesh *mesh) {
    int *edges = (int *)malloc(2 * (size_t)mesh->loop_vertex_count * sizeof(int)), l, i, v, count = 0, different = 0;
    char *used = (char *)calloc((size_t)mesh->vertex_count, 1);
    for (l = 0; l < mesh->loop_count; l++)
        for (i = 0; i < mesh->loops[l].count; i++) {
            const int *loop = mesh->loop_vertices + mesh->loops[l].start;
            int a = loop[i], b = loop[(i + 1) % mesh->loops[l].count];
            edges[2 * count] = a < b ? a : b;
            edges[2 * count++ + 1] = a < b ? b : a;
            used[a] = 1;
        }
    qsort(edges, (size_t)count, 2 * sizeof(int), compare_edges);
    for (i = 0; i < count; i++) different += i == 0 || compare_edges(&edges[2 * i], &edges[2 * i - 2]) != 0;
    for (v = i = 0; v < mesh->vertex_count; v++) i += used[v];
    free(edges);
    free(used);
    return i - different + mesh->face_count - mesh->element_count;
}

static void same_pool(const void *a, const void *b, int count_a, int count_b, size_t size) {
    assert_int_equal(count_a, count_b);
    if (count_a > 0) assert_memory_equal(a, b, (size_t)count_a * size);
}

static void same_mesh(const dgfem_mesh *a, const dgfem_mesh *b) {
    same_pool(a->vertices, b->vertices, a->vertex_count, b->vertex_count, sizeof(dgfem_vec3));
    same_pool(a->faces, b->faces, a->face_count, b->face_count, sizeof(dgfem_face));
    same_pool(a->elements, b->elements, a->element_count, b->element_count, sizeof(dgfem_element));
    same_pool(a->loops, b->loops, a->loop_count, b->loop_count, sizeof(dgfem_loop));
    same_pool(a->loop_vertices, b->loop_vertices, a->loop_vertex_count, b->loop_vertex_count, sizeof(int));
    same_pool(a->element_faces, b->element_faces, a->element_face_count, b->element_face_count, sizeof(int));
}

/* ---- grid ---- */

static void grid_numbering(void **state) {
    enum { NX = 3, NY = 2, NZ = 4 };
    check_host host;
    dgfem_hooks hooks = check_hooks(&host);
    dgfem_grid_desc desc = box_desc(NX, NY, NZ, &hooks);
    dgfem_mesh *mesh;
    int i, j, k, s, stride[3] = {1, NX, NX * NY};
    (void)state;
    desc.lower = at(-1, 2, 3);
    desc.upper = at(0.5, 4, 11); /* cells of 0.5 x 1 x 2 */
    check_status(dgfem_mesh_create_grid(&desc, &mesh), DGFEM_OK);
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    assert_int_equal(mesh->vertex_count, 4 * 3 * 5);
    assert_int_equal(mesh->element_count, NX * NY * NZ);
    assert_int_equal(mesh->face_count, 4 * 2 * 4 + 3 * 3 * 4 + 3 * 2 * 5);
    assert_int_equal(interior_faces(mesh), 2 * 2 * 4 + 3 * 1 * 4 + 3 * 2 * 3);
    assert_int_equal(euler(mesh), 1);
    check_near(dgfem_mesh_volume(mesh), 1.5 * 2 * 8, 64 * CHECK_EPSILON);
    check_near(dgfem_mesh_boundary_area(mesh), 2 * (1.5 * 2 + 1.5 * 8 + 2 * 8), 64 * CHECK_EPSILON);
    for (k = 0; k < NZ; k++)
        for (j = 0; j < NY; j++)
            for (i = 0; i < NX; i++) {
                int e = i + NX * (j + NY * k), ijk[3] = {i, j, k}, cells[3] = {NX, NY, NZ};
                const dgfem_element *element = &mesh->elements[e];
                assert_int_equal(element->tag, e);
                assert_int_equal(element->face_count, 6);
                check_near3(element->centre, at(-1 + 0.5 * (i + 0.5), 2 + j + 0.5, 3 + 2 * (k + 0.5)),
                            32 * CHECK_EPSILON);
                check_near(element->volume, 1, 8 * CHECK_EPSILON);
                check_near(element->radius, sqrt(0.0625 + 0.25 + 1), 32 * CHECK_EPSILON);
                for (s = 0; s < 6; s++) { /* sides in the order -x +x -y +y -z +z */
                    int f = mesh->element_faces[element->face_start + s], axis = s / 2, upper = s % 2;
                    const dgfem_face *face = &mesh->faces[f];
                    static const double area[3] = {2, 1, 0.5};
                    int sign = upper ? 1 : -1;
                    check_near3(dgfemi_scale((dgfem_real)dgfemi_mesh_sign(mesh, e, f), face->normal),
                                at(sign * (axis == 0), sign * (axis == 1), sign * (axis == 2)), 0);
                    check_near3(dgfemi_mesh_unit_normal(mesh, f), face->normal, 4 * CHECK_EPSILON);
                    check_near(face->area, area[axis], 8 * CHECK_EPSILON);
                    if (ijk[axis] == (upper ? cells[axis] - 1 : 0)) {
                        assert_int_equal(face->tag, s);
                        assert_int_equal(face->element[0], e);
                        assert_int_equal(face->element[1], DGFEM_NONE);
                    } else {
                        assert_int_equal(face->tag, DGFEM_NONE);
                        assert_int_equal(face->element[upper], e + (upper ? 1 : -1) * stride[axis]);
                        assert_int_equal(face->element[!upper], e);
                    }
                    assert_int_equal(face->cut, 0);
                }
            }
    check_near3(mesh->vertices[0], desc.lower, 0);
    check_near3(mesh->vertices[mesh->vertex_count - 1], desc.upper, 0);
    dgfem_mesh_destroy(mesh);
    assert_int_equal(host.live, 0);
    assert_int_equal(host.log_count, 0);
}

static void grid_refuses(void **state) {
    check_host host;
    dgfem_hooks hooks = check_hooks(&host);
    dgfem_grid_desc good = box_desc(2, 3, 4, &hooks), desc;
    dgfem_mesh *mesh = (dgfem_mesh *)&host;
    (void)state;
#define REFUSED(change, status, text)                                                                                  \
    do {                                                                                                               \
        desc = good;                                                                                                   \
        change;                                                                                                        \
        check_status(dgfem_mesh_create_grid(&desc, &mesh), status);                                                    \
        assert_null(mesh);                                                                                             \
        check_logged(&host, text);                                                                                     \
    } while (0)
    REFUSED(desc.cells[0] = 0, DGFEM_ERROR_ARGUMENT, "axis x: 0 cells");
    REFUSED(desc.cells[2] = -7, DGFEM_ERROR_ARGUMENT, "axis z: -7 cells");
    REFUSED(desc.upper.y = 0, DGFEM_ERROR_ARGUMENT, "axis y: upper 0 is not above lower 0");
    REFUSED(desc.lower.z = 5, DGFEM_ERROR_ARGUMENT, "axis z: upper 4");
    REFUSED(desc.lower.x = (dgfem_real)NAN, DGFEM_ERROR_NOT_FINITE, "axis x");
    REFUSED(desc.upper.z = (dgfem_real)INFINITY, DGFEM_ERROR_NOT_FINITE, "axis z");
    REFUSED((desc.lower.y = -REAL_MAX, desc.upper.y = REAL_MAX), DGFEM_ERROR_NOT_FINITE, "axis y");
    REFUSED((desc.cells[0] = 1 << 20, desc.cells[1] = 1 << 20), DGFEM_ERROR_ARGUMENT, "too many");
    REFUSED(desc.cells[0] = desc.cells[1] = desc.cells[2] = INT_MAX, DGFEM_ERROR_ARGUMENT, "too many");
    REFUSED(desc.cells[1] = 1 << 27, DGFEM_ERROR_ARGUMENT, "too many");
    REFUSED((desc.lower.x = 1, desc.upper.x = 1 + (dgfem_real)CHECK_EPSILON), DGFEM_ERROR_DEGENERATE, "no width");
    REFUSED(desc.upper.x = desc.upper.y = desc.upper.z = REAL_MAX, DGFEM_ERROR_DEGENERATE, "volume");
#undef REFUSED
    memset(&desc, 0, sizeof desc);
    check_status(dgfem_mesh_create_grid(&desc, &mesh), DGFEM_ERROR_DESCRIPTOR);
    check_status(dgfem_mesh_create_grid(NULL, &mesh), DGFEM_ERROR_DESCRIPTOR);
    check_status(dgfem_mesh_create_grid(&good, NULL), DGFEM_ERROR_ARGUMENT);
    assert_int_equal(host.calls, 0);
}

/* Dyadic coordinates are exact at any offset, and so then is every measure but for the sum with the offset. */
static void measures_do_not_depend_on_the_place(void **state) {
    const double offset = DGFEM_REAL_IS_FLOAT ? 1048576 : 1e6 * 1024;
    dgfem_grid_desc desc = box_desc(3, 2, 2, NULL);
    dgfem_mesh *here, *there;
    int e, f;
    (void)state;
    desc.upper = at(1.5, 1, 1);
    check_status(dgfem_mesh_create_grid(&desc, &here), DGFEM_OK);
    desc.lower = at(offset, -offset, offset);
    desc.upper = at(offset + 1.5, -offset + 1, offset + 1);
    check_status(dgfem_mesh_create_grid(&desc, &there), DGFEM_OK);
    check_status(dgfem_mesh_check(there), DGFEM_OK);
    for (e = 0; e < here->element_count; e++) {
        check_near(there->elements[e].volume, 0.125, 4 * CHECK_EPSILON);
        check_near(there->elements[e].volume, here->elements[e].volume, 0);
        check_near3(there->elements[e].centre, dgfemi_add(here->elements[e].centre, desc.lower),
                    CHECK_EPSILON * offset);
    }
    for (f = 0; f < here->face_count; f++) {
        check_near(there->faces[f].area, here->faces[f].area, 0);
        check_near3(there->faces[f].centre, dgfemi_add(here->faces[f].centre, desc.lower), 0);
    }
    dgfem_mesh_destroy(here);
    dgfem_mesh_destroy(there);
}

static void meshes_of_any_size_and_place(void **state) {
    static const double scales[] = {1e-3, 1, 1e3}, offsets[] = {0, 1e3, 1e6};
    check_random random = check_random_seeded(11);
    size_t s, o;
    (void)state;
    for (s = 0; s < 3; s++)
        for (o = 0; o < 3; o++) {
            kuhn k = kuhn_make(2);
            dgfem_tetrahedra_desc desc = kuhn_desc(&k, NULL);
            dgfem_mesh *mesh;
            double x = scales[s], shift = offsets[o];
            int i;
            if (1e4 * CHECK_EPSILON * shift > x) { /* no digits left in this precision */
                kuhn_free(&k);
                continue;
            }
            for (i = 0; i < 81; i++)
                k.vertices[i] = shift + x * (k.vertices[i] + check_random_real(&random, -0.05, 0.05));
            check_status(dgfem_mesh_create_tetrahedra(&desc, &mesh), DGFEM_OK);
            check_status(dgfem_mesh_check(mesh), DGFEM_OK);
            check_near(dgfem_mesh_volume(mesh), x * x * x, 0.5 * x * x * x);
            for (i = 0; i < mesh->element_count; i++) { /* against long double determinants of the stored vertices */
                const int *t = k.tetrahedra + 4 * i;
                long double d[3][3], det;
                int r;
                for (r = 0; r < 3; r++) {
                    dgfem_vec3 p = mesh->vertices[t[r + 1]], q = mesh->vertices[t[0]];
                    d[r][0] = (long double)p.x - (long double)q.x;
                    d[r][1] = (long double)p.y - (long double)q.y;
                    d[r][2] = (long double)p.z - (long double)q.z;
                }
                det = d[0][0] * (d[1][1] * d[2][2] - d[1][2] * d[2][1]) -
                      d[0][1] * (d[1][0] * d[2][2] - d[1][2] * d[2][0]) +
                      d[0][2] * (d[1][0] * d[2][1] - d[1][1] * d[2][0]);
                check_near(mesh->elements[i].volume, det / 6, 4 * CHECK_EPSILON * x * x * x); /* whatever the offset */
            }
            dgfem_mesh_destroy(mesh);
            kuhn_free(&k);
        }
}

/* ---- tetrahedra ---- */

static void tetrahedra_of_a_cube(void **state) {
    check_host host;
    dgfem_hooks hooks = check_hooks(&host);
    int n;
    (void)state;
    for (n = 1; n <= 4; n++) {
        kuhn k = kuhn_make(n);
        dgfem_tetrahedra_desc desc = kuhn_desc(&k, &hooks);
        dgfem_mesh *mesh;
        int e, i;
        check_status(dgfem_mesh_create_tetrahedra(&desc, &mesh), DGFEM_OK);
        check_status(dgfem_mesh_check(mesh), DGFEM_OK);
        assert_int_equal(mesh->element_count, 6 * n * n * n);
        assert_int_equal(mesh->face_count - interior_faces(mesh), 12 * n * n);
        assert_int_equal(2 * interior_faces(mesh) + 12 * n * n, 24 * n * n * n);
        assert_int_equal(euler(mesh), 1);
        check_near(dgfem_mesh_volume(mesh), 1, 64 * CHECK_EPSILON);
        check_near(dgfem_mesh_boundary_area(mesh), 6, 64 * CHECK_EPSILON);
        for (e = 0; e < mesh->element_count; e++) {
            dgfem_vec3 sum = at(0, 0, 0);
            assert_int_equal(mesh->elements[e].tag, e);
            check_near(mesh->elements[e].volume, 1.0 / 6 / (n * n * n), 4 * CHECK_EPSILON);
            for (i = 0; i < 4; i++) sum = dgfemi_add(sum, mesh->vertices[k.tetrahedra[4 * e + i]]);
            check_near3(mesh->elements[e].centre, dgfemi_scale(DGFEM_R(0.25), sum), 8 * CHECK_EPSILON);
            for (i = 0; i < 4; i++) { /* side i lies opposite vertex i */
                int f = mesh->element_faces[mesh->elements[e].face_start + i];
                dgfem_vec3 apex = mesh->vertices[k.tetrahedra[4 * e + i]];
                dgfem_real height = dgfemi_dot(mesh->faces[f].normal, dgfemi_sub(mesh->faces[f].centre, apex));
                check_near((dgfem_real)dgfemi_mesh_sign(mesh, e, f) * height * mesh->faces[f].area,
                           3 * mesh->elements[e].volume, 8 * CHECK_EPSILON);
            }
        }
        dgfem_mesh_destroy(mesh);
        kuhn_free(&k);
    }
    assert_int_equal(host.live, 0);
    assert_int_equal(host.log_count, 0);
}

/* Vertices as floats, one record of 20 bytes each, and one that no tetrahedron uses: it keeps its index. */
static void tetrahedra_of_strided_points(void **state) {
    struct {
        float p[3];
        int pad[2];
    } points[5] = {
        {{0, 0, 0}, {0, 0}}, {{9, 9, 9}, {0, 0}}, {{1, 0, 0}, {0, 0}}, {{0, 2, 0}, {0, 0}}, {{0, 0, 3}, {0, 0}}};
    const int tetrahedron[4] = {0, 2, 3, 4};
    dgfem_tetrahedra_desc desc = dgfem_default_tetrahedra_desc();
    dgfem_mesh *mesh;
    (void)state;
    desc.vertices = dgfem_points_in_float(points[0].p, 5);
    desc.vertices.stride = (int)sizeof points[0];
    desc.tetrahedra = tetrahedron;
    desc.tetrahedron_count = 1;
    check_status(dgfem_mesh_create_tetrahedra(&desc, &mesh), DGFEM_OK);
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    assert_int_equal(mesh->vertex_count, 5);
    check_near3(mesh->vertices[4], at(0, 0, 3), 0);
    check_near(dgfem_mesh_volume(mesh), 1, 4 * CHECK_EPSILON);
    dgfem_mesh_destroy(mesh);
}

static void tetrahedra_refused(void **state) {
    check_host host;
    dgfem_hooks hooks = check_hooks(&host);
    /* 0 1 2 3 a tetrahedron; 4 below its face 0 1 2, as 5; 6 above it */
    double points[7][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, -1}, {1, 1, -1}, {1, 1, 1}};
    double bad[7][3];
    dgfem_tetrahedra_desc desc = dgfem_default_tetrahedra_desc(), empty;
    dgfem_mesh *mesh = (dgfem_mesh *)&host;
    (void)state;
    desc.vertices = dgfem_points_in_double(points[0], 7);
    desc.hooks = hooks;
#define REFUSED(count, indices, status, text)                                                                          \
    do {                                                                                                               \
        desc.tetrahedra = indices;                                                                                     \
        desc.tetrahedron_count = count;                                                                                \
        check_status(dgfem_mesh_create_tetrahedra(&desc, &mesh), status);                                              \
        assert_null(mesh);                                                                                             \
        assert_int_equal(host.live, 0);                                                                                \
        check_logged(&host, text);                                                                                     \
    } while (0)
    {
        const int high[8] = {0, 1, 2, 3, 0, 1, 7, 4}, low[8] = {0, 1, 2, 3, 0, 1, -2, 4};
        const int inverted[8] = {0, 1, 2, 3, 0, 1, 2, 4}, flat[4] = {0, 1, 2, 2}, one[4] = {0, 1, 2, 3};
        const int third[12] = {0, 1, 2, 3, 0, 2, 1, 4, 0, 2, 1, 5}, overlap[8] = {0, 1, 2, 3, 0, 1, 2, 6};
        const int twice[8] = {0, 1, 2, 3, 1, 2, 0, 3};
        REFUSED(2, high, DGFEM_ERROR_INDEX, "tetrahedron 1 refers to vertex 7 of 7");
        REFUSED(2, low, DGFEM_ERROR_INDEX, "tetrahedron 1 refers to vertex -2 of 7");
        REFUSED(2, inverted, DGFEM_ERROR_DEGENERATE, "tetrahedron 1 is inverted: volume -0.166667");
        REFUSED(1, flat, DGFEM_ERROR_DEGENERATE, "tetrahedron 0 is flat: volume 0");
        REFUSED(3, third, DGFEM_ERROR_NOT_CONFORMING, "tetrahedron 2: face 3 is already between 0 and 1");
        REFUSED(2, overlap, DGFEM_ERROR_NOT_CONFORMING, "tetrahedron 1: overlaps 0, on the same side of face 3");
        REFUSED(2, twice, DGFEM_ERROR_NOT_CONFORMING, "tetrahedron 1: overlaps 0");
        REFUSED(0, one, DGFEM_ERROR_EMPTY, "no tetrahedra");
        REFUSED(-1, one, DGFEM_ERROR_ARGUMENT, "-1 tetrahedra");
        REFUSED(2, NULL, DGFEM_ERROR_ARGUMENT, "no indices for 2 tetrahedra");
        REFUSED(INT_MAX / 12 + 1, one, DGFEM_ERROR_ARGUMENT, "too many faces");
        memcpy(bad, points, sizeof bad);
        bad[6][1] = (double)NAN;
        desc.vertices.data = bad;
        REFUSED(1, one, DGFEM_ERROR_NOT_FINITE, "vertex 6");
        bad[6][1] = (double)-INFINITY;
        REFUSED(1, one, DGFEM_ERROR_NOT_FINITE, "vertex 6");
        bad[6][1] = 1;
        bad[1][0] = bad[2][1] = bad[3][2] = DGFEM_REAL_IS_FLOAT ? 1e30 : 1e200;
        REFUSED(1, one, DGFEM_ERROR_NOT_FINITE, "tetrahedron 0: its volume overflows");
        desc.vertices = dgfem_points_in_double(NULL, 3);
        REFUSED(1, one, DGFEM_ERROR_ARGUMENT, "no data for 3 points");
        desc.vertices = dgfem_points_in_double(points[0], 7);
        desc.vertices.stride = 5;
        REFUSED(1, one, DGFEM_ERROR_ARGUMENT, "stride of 5 bytes");
    }
#undef REFUSED
    memset(&empty, 0, sizeof empty);
    check_status(dgfem_mesh_create_tetrahedra(&empty, &mesh), DGFEM_ERROR_DESCRIPTOR);
    check_status(dgfem_mesh_create_tetrahedra(NULL, &mesh), DGFEM_ERROR_DESCRIPTOR);
    check_status(dgfem_mesh_create_tetrahedra(&desc, NULL), DGFEM_ERROR_ARGUMENT);
}

/* ---- polyhedra ---- */

static dgfem_polyhedron *polyhedron(const dgfem_vec3 *vertices, int vertex_count, int face_count, const int *face_loops,
                                    const int *loop_start, const int *loop_vertices) {
    dgfem_polyhedron_desc desc = dgfem_default_polyhedron_desc();
    dgfem_polyhedron *result = NULL;
    desc.vertices = vertices, desc.vertex_count = vertex_count;
    desc.face_count = face_count, desc.face_loops = face_loops;
    desc.loop_start = loop_start, desc.loop_vertices = loop_vertices;
    check_status(dgfem_polyhedron_create(&desc, &result), DGFEM_OK);
    return result;
}

/* A square hole through a block [0,3]^2 x [z0,z1], the hole being [1,2]^2: ten faces, two of them with two loops. */
static dgfem_polyhedron *holed_block(double z0, double z1) {
    static const int face_loops[11] = {0, 2, 4, 5, 6, 7, 8, 9, 10, 11, 12};
    int loop_start[13], loops[48], i, s;
    dgfem_vec3 v[16];
    for (i = 0; i < 4; i++) {
        double x = i == 1 || i == 2, y = i >= 2;
        for (s = 0; s < 2; s++) {
            v[i + 4 * s] = at(3 * x, 3 * y, s ? z1 : z0);
            v[8 + i + 4 * s] = at(1 + x, 1 + y, s ? z1 : z0);
        }
    }
    for (i = 0; i < 13; i++) loop_start[i] = 4 * i;
    for (i = 0; i < 4; i++) {
        int n = (i + 1) % 4;
        loops[i] = 3 - i, loops[4 + i] = 8 + i;       /* bottom: outer loop seen from below, hole */
        loops[8 + i] = 4 + i, loops[12 + i] = 15 - i; /* top */
        loops[16 + 4 * i] = i, loops[17 + 4 * i] = n, loops[18 + 4 * i] = 4 + n, loops[19 + 4 * i] = 4 + i;
        loops[32 + 4 * i] = 8 + n, loops[33 + 4 * i] = 8 + i, loops[34 + 4 * i] = 12 + i, loops[35 + 4 * i] = 12 + n;
    }
    return polyhedron(v, 16, 10, face_loops, loop_start, loops);
}

static dgfem_polyhedron *block(dgfem_vec3 lower, dgfem_vec3 upper) {
    dgfem_grid_desc desc = dgfem_default_grid_desc();
    dgfem_polyhedron *result = NULL;
    dgfem_mesh *mesh;
    desc.lower = lower, desc.upper = upper;
    check_status(dgfem_mesh_create_grid(&desc, &mesh), DGFEM_OK);
    check_status(dgfem_mesh_element_polyhedron(mesh, 0, &result), DGFEM_OK);
    dgfem_mesh_destroy(mesh);
    return result;
}

static dgfem_mesh *welded(dgfem_polyhedron **polyhedra, int count, const dgfem_hooks *hooks) {
    dgfem_weld_desc desc = dgfem_default_weld_desc();
    dgfem_mesh *mesh = NULL;
    if (hooks) desc.hooks = *hooks;
    check_status(dgfem_mesh_create_polyhedra((const dgfem_polyhedron *const *)polyhedra, count, &desc, &mesh),
                 DGFEM_OK);
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    return mesh;
}

static void destroy_polyhedra(dgfem_polyhedron **polyhedra, int count) {
    int i;
    for (i = 0; i < count; i++) dgfem_polyhedron_destroy(polyhedra[i]);
}

/* Two blocks with a hole on top of each other share a face with two loops; a plug in the lower hole shares its four
   sides; a lid on it that covers hole and plug shares nothing with either but the plug's size. */
static void polyhedra_with_holes(void **state) {
    dgfem_polyhedron *parts[4];
    dgfem_mesh *mesh;
    int f, between[4][4] = {{0}}, e;
    (void)state;
    parts[0] = holed_block(0, 1);
    parts[1] = holed_block(1, 3);
    parts[2] = block(at(1, 1, 0), at(2, 2, 1));
    parts[3] = block(at(0, 0, -1), at(3, 3, 0));
    mesh = welded(parts, 4, NULL);
    assert_int_equal(mesh->element_count, 4);
    assert_int_equal(mesh->vertex_count, 16 + 8 + 4);
    for (f = 0; f < mesh->face_count; f++)
        if (mesh->faces[f].element[1] != DGFEM_NONE) between[mesh->faces[f].element[0]][mesh->faces[f].element[1]]++;
    assert_int_equal(interior_faces(mesh), 5);
    assert_int_equal(between[0][1], 1);
    assert_int_equal(between[0][2], 4);
    for (e = 0; e < 4; e++) assert_int_equal(mesh->elements[e].tag, e);
    check_near(mesh->elements[0].volume, 8, 64 * CHECK_EPSILON);
    check_near(mesh->elements[1].volume, 16, 64 * CHECK_EPSILON);
    check_near(mesh->elements[2].volume, 1, 8 * CHECK_EPSILON);
    check_near3(mesh->elements[1].centre, at(1.5, 1.5, 2), 16 * CHECK_EPSILON);
    check_near(mesh->elements[1].radius, sqrt(4.5 + 1), 16 * CHECK_EPSILON);
    /* by hand: 0: bottom 8, sides 12; 1: top 8, sides 24, hole 8; 2: top 1, bottom 1; 3: 9 + 9 + 12 */
    check_near(dgfem_mesh_boundary_area(mesh), 20 + 40 + 2 + 30, 256 * CHECK_EPSILON);
    for (f = 0; f < mesh->face_count; f++)
        if (mesh->faces[f].loop_count == 2) {
            check_near(mesh->faces[f].area, 8, 32 * CHECK_EPSILON);
            check_near(mesh->faces[f].centre.x, 1.5, 8 * CHECK_EPSILON);
            check_near(mesh->faces[f].centre.y, 1.5, 8 * CHECK_EPSILON);
        }
    dgfem_mesh_destroy(mesh);
    destroy_polyhedra(parts, 4);
}

/* Every element of a mesh as a polyhedron, and the mesh from them again. */
static void polyhedra_round_trip(void **state) {
    check_random random = check_random_seeded(5);
    int round;
    (void)state;
    for (round = 0; round < 4; round++) {
        const double shift = round < 2 ? 0 : DGFEM_REAL_IS_FLOAT ? 8 : 1e3;
        kuhn k = kuhn_make(2);
        dgfem_tetrahedra_desc tetrahedra = kuhn_desc(&k, NULL);
        dgfem_polyhedron *parts[48];
        dgfem_mesh *mesh, *again;
        int i, e;
        for (i = 0; i < 81; i++) k.vertices[i] += shift + check_random_real(&random, -0.05, 0.05);
        if (round % 2) mesh = box(3, 2, 4, NULL);
        else check_status(dgfem_mesh_create_tetrahedra(&tetrahedra, &mesh), DGFEM_OK);
        for (e = 0; e < mesh->element_count; e++) {
            check_status(dgfem_mesh_element_polyhedron(mesh, e, &parts[e]), DGFEM_OK);
            assert_int_equal(parts[e]->face_count, mesh->elements[e].face_count);
            assert_int_equal(parts[e]->vertex_count, round % 2 ? 8 : 4);
            check_near(dgfem_polyhedron_measure(parts[e]).volume, mesh->elements[e].volume, 32 * CHECK_EPSILON);
            check_near3(dgfem_polyhedron_measure(parts[e]).centroid, mesh->elements[e].centre,
                        256 * CHECK_EPSILON * (1 + shift));
            for (i = 0; i < parts[e]->vertex_count; i++) { /* noise well below the tolerance is welded away */
                double noise = (DGFEM_REAL_IS_FLOAT ? 1e-6 : 1e-10) * (shift > 0 ? 0 : 1);
                parts[e]->vertices[i].x += (dgfem_real)check_random_real(&random, -noise, noise);
            }
        }
        again = welded(parts, mesh->element_count, NULL);
        assert_int_equal(again->vertex_count, mesh->vertex_count);
        assert_int_equal(again->face_count, mesh->face_count);
        assert_int_equal(again->element_count, mesh->element_count);
        assert_int_equal(interior_faces(again), interior_faces(mesh));
        assert_int_equal(euler(again), 1);
        for (e = 0; e < mesh->element_count; e++) {
            check_near(again->elements[e].volume, mesh->elements[e].volume, DGFEM_REAL_IS_FLOAT ? 1e-5 : 1e-9);
            for (i = 0; i < mesh->elements[e].face_count; i++) {
                int f = mesh->element_faces[mesh->elements[e].face_start + i];
                int g = again->element_faces[again->elements[e].face_start + i];
                const dgfem_face *a = &mesh->faces[f], *b = &again->faces[g];
                assert_int_equal(a->element[a->element[0] == e], b->element[b->element[0] == e]);
            }
        }
        dgfem_mesh_destroy(mesh);
        dgfem_mesh_destroy(again);
        destroy_polyhedra(parts, e);
        kuhn_free(&k);
    }
}

/* Neighbours that share part of a face only are not joined. */
static void polyhedra_that_do_not_conform_stay_apart(void **state) {
    dgfem_polyhedron *parts[3];
    dgfem_mesh *mesh;
    (void)state;
    parts[0] = block(at(0, 0, 0), at(1, 1, 1));
    parts[1] = block(at(1, 0, 0), at(2, 0.5, 1));
    parts[2] = block(at(1, 0.5, 0), at(2, 1, 1));
    mesh = welded(parts, 3, NULL);
    assert_int_equal(interior_faces(mesh), 1);
    assert_int_equal(mesh->vertex_count, 16);
    dgfem_mesh_destroy(mesh);
    destroy_polyhedra(parts, 3);
}

static void weld_tolerance(void **state) {
    dgfem_weld_desc desc = dgfem_default_weld_desc();
    dgfem_polyhedron *parts[2];
    dgfem_mesh *mesh;
    int round;
    (void)state;
    for (round = 0; round < 3; round++) {
        const double gap = 0.01, tolerance[3] = {0.003, 0.007, 0}; /* times 2: the size of the box */
        const dgfem_polyhedron *const *list = (const dgfem_polyhedron *const *)parts;
        parts[0] = block(at(0, 0, 0), at(1, 1, 1));
        parts[1] = block(at(1 + (round == 2 ? 0 : gap), 0, 0), at(2, 1, 1));
        desc.tolerance = (dgfem_real)tolerance[round];
        check_status(dgfem_mesh_create_polyhedra(list, 2, &desc, &mesh), DGFEM_OK);
        check_status(dgfem_mesh_check(mesh), DGFEM_OK);
        assert_int_equal(interior_faces(mesh), round > 0);
        assert_int_equal(mesh->vertex_count, round > 0 ? 12 : 16);
        dgfem_mesh_destroy(mesh);
        destroy_polyhedra(parts, 2);
    }
}

static void polyhedra_refused(void **state) {
    check_host host;
    dgfem_hooks hooks = check_hooks(&host);
    dgfem_weld_desc desc = dgfem_default_weld_desc(), empty;
    dgfem_polyhedron *parts[4];
    const dgfem_polyhedron *const *list = (const dgfem_polyhedron *const *)parts;
    dgfem_mesh *mesh = (dgfem_mesh *)&host;
    int *v, swap, i;
    (void)state;
    desc.hooks = hooks;
#define REFUSED(list, count, status, text)                                                                             \
    do {                                                                                                               \
        check_status(dgfem_mesh_create_polyhedra(list, count, &desc, &mesh), status);                                  \
        assert_null(mesh);                                                                                             \
        assert_int_equal(host.live, 0);                                                                                \
        check_logged(&host, text);                                                                                     \
    } while (0)
    parts[0] = block(at(0, 0, 0), at(1, 1, 1));
    parts[1] = block(at(1, 0, 0), at(2, 1, 1));
    parts[2] = block(at(1, 0, 0), at(3, 1, 1));
    parts[3] = NULL;
    REFUSED(list, 0, DGFEM_ERROR_EMPTY, "no polyhedra");
    REFUSED(list, -1, DGFEM_ERROR_ARGUMENT, "no array of -1 polyhedra");
    REFUSED(NULL, 1, DGFEM_ERROR_ARGUMENT, "no array of 1 polyhedra");
    REFUSED(list, 4, DGFEM_ERROR_ARGUMENT, "polyhedron 3 is NULL");
    REFUSED(list, 3, DGFEM_ERROR_NOT_CONFORMING, "polyhedron 2: face 0 is already between 0 and 1");
    REFUSED(list + 1, 2, DGFEM_ERROR_NOT_CONFORMING, "polyhedron 1: overlaps 0, on the same side of face 0");
    desc.tolerance = DGFEM_R(-0.001);
    REFUSED(list, 2, DGFEM_ERROR_ARGUMENT, "tolerance -0.001");
    desc.tolerance = (dgfem_real)NAN;
    REFUSED(list, 2, DGFEM_ERROR_ARGUMENT, "tolerance nan");
    desc.tolerance = DGFEM_R(0.05); /* thicker than the plates that follow */
    dgfem_polyhedron_destroy(parts[1]);
    parts[1] = block(at(1, 0, 0), at(1.01, 1, 1));
    REFUSED(list, 2, DGFEM_ERROR_DEGENERATE, "polyhedron 1: face 1 coincides with another of its faces");
    dgfem_polyhedron_destroy(parts[1]);
    parts[1] = block(at(1, 0, 0), at(2, 0.01, 1));
    REFUSED(list, 2, DGFEM_ERROR_DEGENERATE, "polyhedron 1: welding within 0.1 joins vertices");
    desc.tolerance = dgfem_default_weld_desc().tolerance;

    v = parts[1]->loop_vertices + parts[1]->loop_start[3]; /* a face turned round leaves the surface open */
    swap = v[1], v[1] = v[3], v[3] = swap;
    REFUSED(list, 2, DGFEM_ERROR_OPEN, "(polyhedron 1)");
    swap = v[1], v[1] = v[3], v[3] = swap;
    parts[1]->vertices[0].y -= DGFEM_R(0.5);
    REFUSED(list, 2, DGFEM_ERROR_NOT_PLANAR, "(polyhedron 1)");
    parts[1]->vertices[0].y += DGFEM_R(0.5);
    for (i = 0; i < 8; i++) parts[1]->vertices[i].x = -parts[1]->vertices[i].x;
    REFUSED(list, 2, DGFEM_ERROR_INSIDE_OUT, "(polyhedron 1)");
#undef REFUSED
    memset(&empty, 0, sizeof empty);
    check_status(dgfem_mesh_create_polyhedra(list, 2, &empty, &mesh), DGFEM_ERROR_DESCRIPTOR);
    check_status(dgfem_mesh_create_polyhedra(list, 2, NULL, &mesh), DGFEM_ERROR_DESCRIPTOR);
    check_status(dgfem_mesh_create_polyhedra(list, 2, &desc, NULL), DGFEM_ERROR_ARGUMENT);
    destroy_polyhedra(parts, 3);
}

static void element_polyhedron_refused(void **state) {
    check_host host;
    dgfem_hooks hooks = check_hooks(&host);
    dgfem_mesh *mesh = box(2, 1, 1, &hooks);
    dgfem_polyhedron *part;
    (void)state;
    check_status(dgfem_mesh_element_polyhedron(mesh, 2, &part), DGFEM_ERROR_INDEX);
    check_logged(&host, "element 2 of 2");
    check_status(dgfem_mesh_element_polyhedron(mesh, -1, &part), DGFEM_ERROR_INDEX);
    assert_null(part);
    check_status(dgfem_mesh_element_polyhedron(NULL, 0, &part), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_mesh_element_polyhedron(mesh, 0, NULL), DGFEM_ERROR_ARGUMENT);
    dgfem_mesh_destroy(mesh);
}

/* ---- corners ---- */

/* The corners of vertex v by flooding, straight from the definition; checks that they are those of `corners`. Returns
   their number. */
static int flood_corners(const dgfem_mesh *mesh, const dgfem_corners *corners, int v) {
    int n = mesh->element_count, e, f, l, i, c, count = 0, changed, *label = (int *)malloc((size_t)n * sizeof(int));
    for (e = 0; e < n; e++) label[e] = DGFEM_NONE;
    do {
        changed = 0;
        for (f = 0; f < mesh->face_count; f++) {
            const dgfem_face *face = &mesh->faces[f];
            int touches = 0, a = face->element[0], b = face->element[1];
            for (l = face->loop_start; l < face->loop_start + face->loop_count; l++)
                for (i = 0; i < mesh->loops[l].count; i++)
                    touches |= mesh->loop_vertices[mesh->loops[l].start + i] == v;
            if (!touches) continue;
            if (label[a] == DGFEM_NONE) label[a] = a, changed = 1;
            if (b == DGFEM_NONE) continue;
            if (label[b] == DGFEM_NONE) label[b] = b, changed = 1;
            if (!face->cut && label[a] != label[b]) {
                label[a] = label[b] = label[a] < label[b] ? label[a] : label[b];
                changed = 1;
            }
        }
    } while (changed);
    for (e = 0; e < n; e++) count += label[e] == e;
    for (c = 0; c < corners->count; c++) {
        int first = corners->elements[corners->element_start[c]];
        if (corners->vertex[c] != v) continue;
        assert_int_equal(label[first], first);
        for (e = 0, i = corners->element_start[c]; e < n; e++) {
            if (label[e] != first) continue;
            assert_true(i < corners->element_start[c + 1]);
            assert_int_equal(corners->elements[i++], e);
        }
        assert_int_equal(i, corners->element_start[c + 1]);
        count--;
    }
    assert_int_equal(count, 0);
    for (c = e = 0; c < corners->count; c++) e += corners->vertex[c] == v;
    free(label);
    return e;
}

/* Number of corners, after a check of everything about them. */
static int count_corners(const dgfem_mesh *mesh) {
    dgfem_corners *corners;
    int c, e, i, j, v, sum = 0, count;
    check_status(dgfem_mesh_corners(mesh, &corners), DGFEM_OK);
    count = corners->count;
    for (v = 0; v < mesh->vertex_count; v++) sum += flood_corners(mesh, corners, v);
    assert_int_equal(sum, count);
    assert_int_equal(corners->element_start[count], corners->corner_start[mesh->element_count]);
    for (c = 1; c < count; c++) assert_true(corners->vertex[c - 1] <= corners->vertex[c]);
    for (e = 0; e < mesh->element_count; e++)
        for (i = corners->corner_start[e]; i < corners->corner_start[e + 1]; i++) {
            int found = 0;
            c = corners->corners[i];
            if (i > corners->corner_start[e]) assert_true(corners->corners[i - 1] < c);
            for (j = corners->element_start[c]; j < corners->element_start[c + 1]; j++)
                found += corners->elements[j] == e;
            assert_int_equal(found, 1);
        }
    dgfem_corners_destroy(corners);
    return count;
}

static void cut_between(dgfem_mesh *mesh, int a, int b) {
    int f, found = 0;
    for (f = 0; f < mesh->face_count; f++)
        if ((mesh->faces[f].element[0] == a && mesh->faces[f].element[1] == b) ||
            (mesh->faces[f].element[0] == b && mesh->faces[f].element[1] == a))
            mesh->faces[f].cut = 1, found++;
    assert_true(found > 0);
}

static void corners_by_hand(void **state) {
    dgfem_mesh *mesh;
    kuhn k = kuhn_make(2);
    dgfem_tetrahedra_desc desc = kuhn_desc(&k, NULL);
    int e;
    (void)state;

    mesh = box(3, 2, 4, NULL);
    assert_int_equal(count_corners(mesh), 4 * 3 * 5);
    dgfem_mesh_destroy(mesh);

    mesh = box(2, 1, 1, NULL); /* two separate cubes */
    cut_between(mesh, 0, 1);
    assert_int_equal(count_corners(mesh), 16);
    dgfem_mesh_destroy(mesh);

    mesh = box(2, 2, 1, NULL); /* a crack from the boundary to the middle opens at its mouth only, then all through */
    cut_between(mesh, 0, 1);
    assert_int_equal(count_corners(mesh), 18 + 2);
    cut_between(mesh, 2, 3);
    assert_int_equal(count_corners(mesh), 18 + 6);
    dgfem_mesh_destroy(mesh);

    mesh = box(2, 2, 1, NULL); /* one of four columns cut off, then the next one: a T */
    cut_between(mesh, 0, 1);
    cut_between(mesh, 0, 2);
    assert_int_equal(count_corners(mesh), 18 + 6);
    cut_between(mesh, 2, 3);
    assert_int_equal(count_corners(mesh), 18 + 6 + 4);
    dgfem_mesh_destroy(mesh);

    mesh = box(2, 2, 2, NULL); /* one face in a block opens at one vertex; a plane of four at nine; a cube at seven */
    cut_between(mesh, 0, 1);
    assert_int_equal(count_corners(mesh), 27 + 1);
    cut_between(mesh, 2, 3), cut_between(mesh, 4, 5), cut_between(mesh, 6, 7);
    assert_int_equal(count_corners(mesh), 27 + 9);
    dgfem_mesh_destroy(mesh);
    mesh = box(2, 2, 2, NULL);
    cut_between(mesh, 0, 1), cut_between(mesh, 0, 2), cut_between(mesh, 0, 4);
    assert_int_equal(count_corners(mesh), 27 + 7);
    dgfem_mesh_destroy(mesh);

    mesh = box(3, 3, 3, NULL); /* a crack inside, that does not open, and a cube cut out of the middle, that does */
    cut_between(mesh, 13, 14);
    assert_int_equal(count_corners(mesh), 64);
    cut_between(mesh, 13, 12), cut_between(mesh, 13, 10), cut_between(mesh, 13, 16), cut_between(mesh, 13, 4);
    cut_between(mesh, 13, 22);
    assert_int_equal(count_corners(mesh), 64 + 8);
    dgfem_mesh_destroy(mesh);

    check_status(dgfem_mesh_create_tetrahedra(&desc, &mesh), DGFEM_OK); /* all apart */
    assert_int_equal(count_corners(mesh), 27);
    for (e = 0; e < mesh->face_count; e++) mesh->faces[e].cut = mesh->faces[e].element[1] != DGFEM_NONE;
    assert_int_equal(count_corners(mesh), 4 * 48);
    dgfem_mesh_destroy(mesh);
    kuhn_free(&k);
}

static void corners_of_random_cuts(void **state) {
    check_random random = check_random_seeded(3);
    kuhn k = kuhn_make(2);
    dgfem_tetrahedra_desc desc = kuhn_desc(&k, NULL);
    int round, f;
    (void)state;
    for (round = 0; round < 12; round++) {
        dgfem_mesh *mesh;
        if (round % 2) mesh = box(3, 3, 2, NULL);
        else check_status(dgfem_mesh_create_tetrahedra(&desc, &mesh), DGFEM_OK);
        for (f = 0; f < mesh->face_count; f++)
            mesh->faces[f].cut = mesh->faces[f].element[1] != DGFEM_NONE && check_random_int(&random, 12) < round;
        count_corners(mesh);
        dgfem_mesh_destroy(mesh);
    }
    kuhn_free(&k);
}

/* Two cubes that touch at an edge only have their own corners there. */
static void corners_where_elements_only_touch(void **state) {
    const int labels[4] = {0, -1, -1, 3};
    dgfem_mesh *mesh = labelled_box(2, 2, 1, labels, NULL);
    dgfem_corners *corners;
    (void)state;
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    assert_int_equal(mesh->vertex_count, 14);
    assert_int_equal(count_corners(mesh), 16);
    check_status(dgfem_mesh_corners(mesh, NULL), DGFEM_ERROR_ARGUMENT);
    dgfem_mesh_destroy(mesh);
    check_status(dgfem_mesh_corners(NULL, &corners), DGFEM_ERROR_ARGUMENT);
    assert_null(corners);
    dgfem_corners_destroy(NULL);
}

/* ---- the check ---- */

/* A mesh with all there is: cubes, a face with two loops, a plug. Element 0 is the lower block, 2 the plug. */
static dgfem_mesh *rich_mesh(const dgfem_hooks *hooks) {
    dgfem_polyhedron *parts[3];
    dgfem_mesh *mesh;
    parts[0] = holed_block(0, 1);
    parts[1] = holed_block(1, 3);
    parts[2] = block(at(1, 1, 0), at(2, 2, 1));
    mesh = welded(parts, 3, hooks);
    destroy_polyhedra(parts, 3);
    return mesh;
}

static void reverse_loop(dgfem_mesh *mesh, int loop) {
    int *v = mesh->loop_vertices + mesh->loops[loop].start, n = mesh->loops[loop].count, i;
    for (i = 0; i < n / 2; i++) {
        int swap = v[i];
        v[i] = v[n - 1 - i], v[n - 1 - i] = swap;
    }
}

/* Reflected at x = 0 with normals and measures to match: consistent, but inside out. */
static void mirror(dgfem_mesh *mesh) {
    int v;
    for (v = 0; v < mesh->vertex_count; v++) mesh->vertices[v].x = -mesh->vertices[v].x;
    remeasure(mesh);
}

static void check_finds_every_corruption(void **state) {
    check_host host;
    dgfem_hooks hooks = check_hooks(&host);
    dgfem_mesh *const good = rich_mesh(&hooks), *m;
    const dgfem_real nan_real = (dgfem_real)NAN, small = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-3) : DGFEM_R(1e-9);
    int i, holed = DGFEM_NONE, inner = DGFEM_NONE, outer = DGFEM_NONE, *list;
    (void)state;
    for (i = 0; i < good->face_count; i++) {
        if (good->faces[i].loop_count == 2 && good->faces[i].element[1] != DGFEM_NONE) holed = i;
        if (good->faces[i].element[0] == 0 && good->faces[i].element[1] == 2) inner = i;
        if (good->faces[i].element[0] == 1 && good->faces[i].element[1] == DGFEM_NONE) outer = i;
    }
    assert_true(holed != DGFEM_NONE && inner != DGFEM_NONE && outer != DGFEM_NONE);
    check_status(dgfem_mesh_check(good), DGFEM_OK);
    check_status(dgfem_mesh_check(NULL), DGFEM_ERROR_ARGUMENT);
#define LOOP(face) (m->loop_vertices + m->loops[m->faces[face].loop_start].start)
#define BROKEN(change, text)                                                                                           \
    do {                                                                                                               \
        check_status(dgfem_mesh_copy(good, &m), DGFEM_OK);                                                             \
        assert_true(dgfemi_mesh_reserve(m, 8, 8, 8, 8, 64, 64));                                                       \
        change;                                                                                                        \
        check_status(dgfem_mesh_check(m), DGFEM_ERROR_INVARIANT);                                                      \
        check_logged(&host, text);                                                                                     \
        dgfem_mesh_destroy(m);                                                                                         \
    } while (0)
    /* arrays */
    BROKEN(m->loop_count = m->loop_capacity + 1, "loops: count");
    BROKEN(m->vertex_count = -1, "vertices: count -1");
    BROKEN(m->element_count = 0, "no elements");
    BROKEN((free(m->element_faces), host.live--, m->element_faces = NULL), "element_faces: count");
    /* vertices */
    BROKEN(m->vertices[5].y = nan_real, "vertex 5 is not finite");
    BROKEN(m->vertices[7].z = (dgfem_real)INFINITY, "vertex 7 is not finite");
    BROKEN(m->vertices[LOOP(outer)[0]].x -= DGFEM_R(0.01), "face");
    /* loops */
    BROKEN(m->loops[m->faces[3].loop_start].count = 2, "face 3: loop");
    BROKEN(m->loops[m->faces[3].loop_start].start = m->loop_vertex_count - 1, "face 3: loop");
    BROKEN(m->loops[m->faces[3].loop_start].start = -4, "face 3: loop");
    BROKEN(m->loops[m->faces[3].loop_start] = m->loops[m->faces[2].loop_start], "shared with another loop");
    BROKEN(LOOP(4)[1] = m->vertex_count, "face 4: loop");
    BROKEN(LOOP(4)[1] = -1, "face 4: loop");
    BROKEN(LOOP(4)[1] = LOOP(4)[2], "twice in a row");
    BROKEN(LOOP(4)[0] = LOOP(4)[2], "straight back");
    BROKEN(LOOP(4)[0] = LOOP(outer)[0] == LOOP(4)[0] ? LOOP(outer)[2] : LOOP(outer)[0], "element");
    BROKEN((i = LOOP(4)[0], LOOP(4)[0] = LOOP(4)[1], LOOP(4)[1] = i), "edge from vertex");
    BROKEN(reverse_loop(m, m->faces[outer].loop_start), "element 1: edge from vertex");
    BROKEN(reverse_loop(m, m->faces[inner].loop_start), "edge from vertex");
    BROKEN(reverse_loop(m, m->faces[holed].loop_start + 1), "edge from vertex");
    /* faces */
    BROKEN(m->faces[outer].element[0] = DGFEM_NONE, "elements -1 and -1 of 3");
    BROKEN(m->faces[outer].element[0] = 3, "elements 3 and -1 of 3");
    BROKEN(m->faces[inner].element[1] = 3, "elements 0 and 3 of 3");
    BROKEN(m->faces[inner].element[1] = -2, "elements 0 and -2 of 3");
    BROKEN(m->faces[inner].element[1] = 0, "element 0 on both sides");
    BROKEN(m->faces[inner].element[1] = DGFEM_NONE, "element 2 lists face");
    BROKEN(m->faces[inner].element[1] = 1, "element 2 lists face");
    BROKEN(m->faces[outer].element[0] = 0, "element 1 lists face");
    BROKEN(m->faces[outer].element[1] = 0, "is listed by 1 of them");
    BROKEN((m->faces[inner].element[0] = 2, m->faces[inner].element[1] = 0), "edge from vertex");
    BROKEN(m->faces[inner].cut = 2, "cut is 2");
    BROKEN(m->faces[holed].loop_count = 0, "out of range or shared");
    BROKEN(m->faces[holed].loop_start = m->loop_count - 1, "out of range or shared");
    BROKEN(m->faces[2].loop_start = m->faces[3].loop_start, "shared with another face");
    BROKEN(m->faces[holed].loop_count = 1, "edge from vertex"); /* the hole is gone */
    BROKEN(m->faces[3].normal = dgfemi_scale(1 + 256 * (dgfem_real)CHECK_EPSILON, m->faces[3].normal),
           "face 3: normal");
    BROKEN(m->faces[3].normal.x = nan_real, "face 3: normal");
    BROKEN(m->faces[3].normal = dgfemi_scale(-1, m->faces[3].normal), "face 3");
    BROKEN((m->faces[3].normal = dgfemi_scale(-1, m->faces[3].normal), dgfemi_mesh_measure_face(m, 3)),
           "face 3: its loops");
    BROKEN((m->faces[3].normal = dgfemi_normalized(dgfemi_add(m->faces[3].normal, at(0.2, 0.2, 0.2))),
            dgfemi_mesh_measure_face(m, 3)),
           "face 3: a vertex is");
    BROKEN(m->faces[3].area *= 1 + small, "face 3: area is");
    BROKEN(m->faces[3].area = nan_real, "face 3: area is");
    BROKEN(m->faces[3].area = -m->faces[3].area, "face 3: area is");
    BROKEN(m->faces[holed].centre.x += small, "centre is");
    BROKEN(m->faces[holed].centre.y = nan_real, "centre is");
    /* elements */
    BROKEN(m->elements[1].face_count = 0, "element 1: faces");
    BROKEN(m->elements[1].face_start = -1, "element 1: faces");
    BROKEN(m->elements[1].face_count = INT_MAX, "element 1: faces");
    BROKEN(m->elements[2].face_start = m->elements[0].face_start, "element 2: faces");
    BROKEN(m->element_faces[m->elements[1].face_start] = m->face_count, "element 1 refers to face");
    BROKEN(m->element_faces[m->elements[1].face_start] = -1, "element 1 refers to face -1");
    BROKEN((list = m->element_faces + m->elements[1].face_start, list[0] = list[1]), "element 1 lists face");
    BROKEN(m->element_faces[m->elements[1].face_start] = inner, "element 1 lists face");
    BROKEN((m->elements[1].face_start++, m->elements[1].face_count--), "is listed by");
    BROKEN(m->elements[2].face_count--, "is listed by 0 of them");
    BROKEN((m->faces[0].element[0] = 1, list = m->element_faces + m->element_face_count,
            memcpy(list, m->element_faces + m->elements[1].face_start, (size_t)m->elements[1].face_count * sizeof(int)),
            list[m->elements[1].face_count] = 0, m->elements[1].face_start = m->element_face_count,
            m->element_face_count += ++m->elements[1].face_count, m->elements[0].face_start++,
            m->elements[0].face_count--),
           "element 0: edge from vertex"); /* a face moved to another element */
    BROKEN(m->elements[2].volume *= 1 + small, "element 2: volume is");
    BROKEN(m->elements[2].volume = nan_real, "element 2: volume");
    BROKEN(m->elements[2].volume = -1, "element 2: volume -1");
    BROKEN(m->elements[2].volume = 0, "element 2: volume 0");
    BROKEN(m->elements[0].centre.z += small, "element 0: centre is");
    BROKEN(m->elements[0].centre.z = nan_real, "element 0: centre is");
    BROKEN(m->elements[1].radius *= 1 + small, "element 1: radius is");
    BROKEN(m->elements[1].radius = (dgfem_real)INFINITY, "element 1: radius is");
    BROKEN(m->elements[1].radius = nan_real, "element 1: radius nan");
    BROKEN(m->elements[1].radius = 0, "element 1: radius 0");
    /* geometry that is measured as it is */
    BROKEN(mirror(m), "element 0: volume -8");
    BROKEN((m->vertices[LOOP(outer)[0]] = dgfemi_add(m->vertices[LOOP(outer)[0]], at(0.4, 0.4, 0.4)), remeasure(m)),
           "off its plane");
#undef BROKEN
#undef LOOP
    check_status(dgfem_mesh_check(good), DGFEM_OK);
    dgfem_mesh_destroy(good);
    assert_int_equal(host.live, 0);
}

/* An element that touches itself at an edge is sound; one whose faces coincide there is not. */
static void check_of_edges_with_four_faces(void **state) {
    check_host host;
    dgfem_hooks hooks = check_hooks(&host);
    const int labels[8] = {0, 0, 0, -1, 0, -1, -1, 0}; /* 0 and 7 are opposite; 1, 2, 4 join none of 7's faces */
    const int ring[8] = {0, 0, -1, 0, 0, -1, 0, 0};    /* touches itself along two edges */
    dgfem_mesh *mesh = labelled_box(2, 2, 2, labels, &hooks);
    int e, f, found = 0;
    (void)state;
    check_status(dgfem_mesh_check(mesh), DGFEM_OK); /* 7 has edges with 1, 2, 4 in common */
    dgfem_mesh_destroy(mesh);
    mesh = labelled_box(2, 2, 2, ring, &hooks);
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    check_near(dgfem_mesh_volume(mesh), 6, 64 * CHECK_EPSILON);
    dgfem_mesh_destroy(mesh);

    mesh = box(2, 1, 1, &hooks); /* two cubes whose common face is there twice: a cut gone wrong */
    for (f = 0; f < mesh->face_count; f++) {
        int loop[4], i;
        if (mesh->faces[f].element[1] == DGFEM_NONE) continue;
        for (i = 0; i < 4; i++) loop[3 - i] = mesh->loop_vertices[mesh->loops[mesh->faces[f].loop_start].start + i];
        e = dgfemi_mesh_add_face(mesh, dgfemi_mesh_add_loop(mesh, loop, 4), 1, 0, DGFEM_NONE, DGFEM_NONE,
                                 dgfemi_scale(-1, mesh->faces[f].normal));
        dgfemi_mesh_measure_face(mesh, e);
        mesh->faces[f].element[1] = DGFEM_NONE;
        for (i = 6; i < 12; i++) /* cube 1 looks at the new face from its other side */
            if (mesh->element_faces[i] == f) mesh->element_faces[i] = e, found++;
        break;
    }
    assert_int_equal(found, 1);
    { /* both cubes as one element */
        int faces[12], i;
        memcpy(faces, mesh->element_faces, sizeof faces);
        for (i = 0; i < mesh->face_count; i++) mesh->faces[i].element[0] = 0;
        mesh->elements[0].face_start = mesh->element_face_count;
        assert_true(dgfemi_mesh_add_element(mesh, faces, 12, 0) >= 0);
        mesh->elements[0].face_count = 12;
        mesh->element_count = 1;
        dgfemi_mesh_measure_element(mesh, 0);
    }
    check_status(dgfem_mesh_check(mesh), DGFEM_ERROR_INVARIANT);
    check_logged(&host, "element 0: edge from vertex");
    dgfem_mesh_destroy(mesh);
}

/* ---- merging ---- */

static void merge_into_the_largest_face(void **state) {
    static const double x[4] = {0, 1, 1.01, 2}, y[3] = {0, 1, 2}, z[2] = {0, 1};
    static const double y2[4] = {0, 0.995, 1.005, 2}, x2[4] = {0, 0.5, 0.51, 2};
    check_host host;
    dgfem_hooks hooks = check_hooks(&host);
    dgfem_mesh *mesh;
    int merged = -1, left = -1, f;
    (void)state;

    mesh = box_of_planes(3, x, 1, y, 1, z, &hooks); /* equal faces: the lower index */
    check_status(dgfem_mesh_merge_slivers(mesh, DGFEM_R(0.1), &merged, &left), DGFEM_OK);
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    assert_int_equal(merged, 1);
    assert_int_equal(left, 0);
    assert_int_equal(mesh->element_count, 2);
    assert_int_equal(mesh->elements[0].tag, 0);
    assert_int_equal(mesh->elements[1].tag, 2);
    assert_int_equal(mesh->elements[0].face_count, 10); /* faces in one plane stay apart */
    assert_int_equal(mesh->face_count, 15);
    assert_int_equal(mesh->vertex_count, 16); /* and so do the vertices between them */
    check_near(mesh->elements[0].volume, 1.01, 16 * CHECK_EPSILON);
    check_near3(mesh->elements[0].centre, at(0.505, 0.5, 0.5), 16 * CHECK_EPSILON);
    check_near(dgfem_mesh_volume(mesh), 2, 16 * CHECK_EPSILON);
    check_near(dgfem_mesh_boundary_area(mesh), 10, 64 * CHECK_EPSILON);
    check_status(dgfem_mesh_merge_slivers(mesh, DGFEM_R(0.1), &merged, &left), DGFEM_OK);
    assert_int_equal(merged, 0);
    assert_int_equal(left, 0);
    dgfem_mesh_destroy(mesh);

    mesh = box_of_planes(3, x, 1, y, 1, z, &hooks); /* not across a cut */
    cut_between(mesh, 0, 1);
    check_status(dgfem_mesh_merge_slivers(mesh, DGFEM_R(0.1), &merged, &left), DGFEM_OK);
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    assert_int_equal(merged, 1);
    check_near(mesh->elements[1].volume, 1, 16 * CHECK_EPSILON);
    for (f = 0; f < mesh->face_count; f++)
        assert_int_equal(mesh->faces[f].cut, mesh->faces[f].element[1] != DGFEM_NONE);
    assert_int_equal(count_corners(mesh), mesh->vertex_count + 4);
    dgfem_mesh_destroy(mesh);

    mesh = box_of_planes(3, x, 1, y, 1, z, &hooks); /* cut on both sides: it stays */
    cut_between(mesh, 0, 1), cut_between(mesh, 1, 2);
    check_status(dgfem_mesh_merge_slivers(mesh, DGFEM_R(0.1), &merged, &left), DGFEM_OK);
    assert_int_equal(merged, 0);
    assert_int_equal(left, 1);
    assert_int_equal(mesh->element_count, 3);
    dgfem_mesh_destroy(mesh);

    /* A 3 x 3 x 1 box whose middle row and column are thin. The central sliver (4) goes into the neighbour with the
       larger faces (tie: 1 and 7 have 0.01 in common with it, as 3 and 5), then each arm into its longest side. */
    mesh = box_of_planes(3, x2, 3, y2, 1, z, &hooks);
    check_status(dgfem_mesh_merge_slivers(mesh, DGFEM_R(0.1), &merged, &left), DGFEM_OK);
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    assert_int_equal(merged, 5);
    assert_int_equal(left, 0);
    assert_int_equal(mesh->element_count, 4);
    check_near(dgfem_mesh_volume(mesh), 4, 64 * CHECK_EPSILON);
    check_near(dgfem_mesh_boundary_area(mesh), 16, 64 * CHECK_EPSILON);
    dgfem_mesh_destroy(mesh);
    assert_int_equal(host.log_count, 0);
    assert_int_equal(host.live, 0);
}

/* A row of boxes of these lengths, merged; the tags of what stays say who went into whom. */
static void merge_row(int count, const double *lengths, double limit, int left, const int *lengths_after,
                      const int *tags, int after) {
    static const double unit[2] = {0, 1};
    double x[8] = {0};
    dgfem_mesh *mesh;
    int i, merged, stayed;
    for (i = 0; i < count; i++) x[i + 1] = x[i] + lengths[i];
    mesh = box_of_planes(count, x, 1, unit, 1, unit, NULL);
    check_status(dgfem_mesh_merge_slivers(mesh, (dgfem_real)limit, &merged, &stayed), DGFEM_OK);
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    assert_int_equal(mesh->element_count, after);
    assert_int_equal(merged, count - after);
    assert_int_equal(stayed, left);
    for (i = 0; i < after; i++) {
        assert_int_equal(mesh->elements[i].tag, tags[i]);
        check_near(mesh->elements[i].volume, lengths_after[i], 64 * CHECK_EPSILON);
    }
    dgfem_mesh_destroy(mesh);
}

static void merge_the_smallest_first(void **state) {
    static const double falling[3] = {2, 1, 10}, growing[4] = {1, 1.5, 2.5, 10};
    static const int falling_after[2] = {3, 10}, falling_tags[2] = {0, 2};
    static const int growing_after[2] = {5, 10}, growing_tags[2] = {2, 3};
    (void)state;
    merge_row(3, falling, 2.25, 0, falling_after, falling_tags, 2); /* 1 goes into 0, which then is large enough */
    /* 0 goes into 1, which is still the smallest but one and goes into 2 before 2 has its turn */
    merge_row(4, growing, 2.625, 0, growing_after, growing_tags, 2);
}

static void merge_without_neighbours(void **state) {
    const int apart[4] = {0, -1, -1, 3};
    dgfem_mesh *mesh = box(1, 1, 1, NULL), *copy;
    int merged, left;
    (void)state;
    check_status(dgfem_mesh_copy(mesh, &copy), DGFEM_OK);
    check_status(dgfem_mesh_merge_slivers(mesh, 10, &merged, &left), DGFEM_OK);
    assert_int_equal(merged, 0);
    assert_int_equal(left, 1);
    same_mesh(mesh, copy);
    check_status(dgfem_mesh_merge_slivers(mesh, 0, &merged, &left), DGFEM_OK);
    assert_int_equal(left, 0);
    check_status(dgfem_mesh_merge_slivers(mesh, 10, NULL, NULL), DGFEM_OK);
    dgfem_mesh_destroy(mesh);
    dgfem_mesh_destroy(copy);
    mesh = labelled_box(2, 2, 1, apart, NULL); /* an edge in common is no face in common */
    check_status(dgfem_mesh_merge_slivers(mesh, 10, &merged, &left), DGFEM_OK);
    assert_int_equal(merged, 0);
    assert_int_equal(left, 2);
    dgfem_mesh_destroy(mesh);
}

static void merge_everything(void **state) {
    dgfem_mesh *mesh = box(3, 3, 3, NULL);
    int labels[27], i, merged, left;
    (void)state;
    check_status(dgfem_mesh_merge_slivers(mesh, 28, &merged, &left), DGFEM_OK); /* all of it is small: one lump stays */
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    assert_int_equal(merged, 26);
    assert_int_equal(left, 1);
    assert_int_equal(mesh->face_count, 54);
    assert_int_equal(mesh->vertex_count, 56);
    check_near(mesh->elements[0].volume, 27, 128 * CHECK_EPSILON);
    dgfem_mesh_destroy(mesh);

    for (i = 0; i < 27; i++) labels[i] = i == 13; /* a core inside a shell: what lies between vanishes */
    mesh = labelled_box(3, 3, 3, labels, NULL);
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    check_near(mesh->elements[0].volume, 26, 128 * CHECK_EPSILON);
    check_status(dgfem_mesh_merge_slivers(mesh, 2, &merged, &left), DGFEM_OK);
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    assert_int_equal(merged, 1);
    assert_int_equal(mesh->face_count, 54);
    assert_int_equal(mesh->vertex_count, 56);
    check_near(mesh->elements[0].volume, 27, 128 * CHECK_EPSILON);
    check_near(mesh->elements[0].radius, sqrt(27) / 2, 16 * CHECK_EPSILON);
    dgfem_mesh_destroy(mesh);

    for (i = 0; i < 9; i++) labels[i] = i == 4; /* a plug in a ring: four faces between the two, one of them cut */
    mesh = labelled_box(3, 3, 1, labels, NULL);
    assert_int_equal(interior_faces(mesh), 4);
    for (i = 0; mesh->faces[i].element[1] == DGFEM_NONE; i++) continue;
    mesh->faces[i].cut = 1;
    check_status(dgfem_mesh_merge_slivers(mesh, 2, &merged, &left), DGFEM_OK);
    assert_int_equal(merged, 0);
    assert_int_equal(left, 1);
    mesh->faces[i].cut = 0;
    check_status(dgfem_mesh_merge_slivers(mesh, 2, &merged, &left), DGFEM_OK);
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    assert_int_equal(merged, 1);
    assert_int_equal(mesh->elements[0].face_count, 30);
    dgfem_mesh_destroy(mesh);
}

/* Cube 0 and the chain 1-3-7-6 have the face of 0 and 1 in common, and also the edge between 0 and 6, where they must
   not grow together. */
static void merge_keeps_edges_simple(void **state) {
    const int labels[8] = {0, 1, 2, 1, 4, 5, 1, 1}, alone[8] = {0, 1, -1, 1, -1, -1, 1, 1};
    dgfem_mesh *mesh = labelled_box(2, 2, 2, labels, NULL);
    int merged, left, e, total = 0;
    (void)state;
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    for (e = 0; e < mesh->element_count; e++) total += mesh->elements[e].volume < DGFEM_R(1.5);
    assert_int_equal(total, 4);
    check_status(dgfem_mesh_merge_slivers(mesh, DGFEM_R(1.5), &merged, &left), DGFEM_OK);
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    for (e = 0; mesh->elements[e].tag != 2; e++) assert_true(mesh->elements[e].tag != 0);
    check_near(mesh->elements[e].volume, 3, 16 * CHECK_EPSILON); /* 0 and 4 went elsewhere: into 2 */
    check_near3(mesh->elements[e].centre, at(0.5, 5.0 / 6, 5.0 / 6), 16 * CHECK_EPSILON);
    check_near(dgfem_mesh_volume(mesh), 8, 64 * CHECK_EPSILON);
    dgfem_mesh_destroy(mesh);

    mesh = labelled_box(2, 2, 2, alone, NULL);
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    check_status(dgfem_mesh_merge_slivers(mesh, DGFEM_R(1.5), &merged, &left), DGFEM_OK);
    assert_int_equal(merged, 0);
    assert_int_equal(left, 1);
    dgfem_mesh_destroy(mesh);
}

/* Would the union of two elements be sound, by sorting all directed edges? */
static int mergeable(const dgfem_mesh *mesh, int a, int b) {
    int *edges, pass, k, l, i, count = 0, sound = 1;
    double glued = 0;
    edges = (int *)malloc(4 * (size_t)mesh->loop_vertex_count * sizeof(int));
    for (pass = 0; pass < 2; pass++) {
        const dgfem_element *element = &mesh->elements[pass ? b : a];
        for (k = element->face_start; k < element->face_start + element->face_count; k++) {
            int f = mesh->element_faces[k], sign = dgfemi_mesh_sign(mesh, pass ? b : a, f);
            const dgfem_face *face = &mesh->faces[f];
            int shared =
                (face->element[0] == a && face->element[1] == b) || (face->element[0] == b && face->element[1] == a);
            if (shared && face->cut) sound = 0;
            if (shared) glued += (double)face->area;
            for (l = face->loop_start; !shared && l < face->loop_start + face->loop_count; l++)
                for (i = 0; i < mesh->loops[l].count; i++) {
                    const int *loop = mesh->loop_vertices + mesh->loops[l].start;
                    int from = loop[i], to = loop[(i + 1) % mesh->loops[l].count];
                    edges[2 * count] = sign > 0 ? from : to;
                    edges[2 * count++ + 1] = sign > 0 ? to : from;
                }
        }
    }
    qsort(edges, (size_t)count, 2 * sizeof(int), compare_edges);
    for (i = 1; i < count; i++) sound &= compare_edges(&edges[2 * i], &edges[2 * i - 2]) != 0;
    free(edges);
    return sound && glued > 0;
}

/* Boxes of random planes with random cuts, merged with ever higher limits: sound after each, nothing lost, and nothing
   left that could still be merged. */
static void merge_at_random(void **state) {
    check_random random = check_random_seeded(8);
    int round, i, f, e, axis;
    (void)state;
    for (round = 0; round < 12; round++) {
        double planes[3][6], volume, area;
        dgfem_mesh *mesh;
        double limit;
        for (axis = 0; axis < 3; axis++)
            for (planes[axis][0] = 0, i = 1; i < 6; i++)
                planes[axis][i] = planes[axis][i - 1] + pow(10, check_random_real(&random, -1.5, 0));
        mesh = box_of_planes(4, planes[0], 5, planes[1], 3, planes[2], NULL);
        for (f = 0; f < mesh->face_count; f++)
            mesh->faces[f].cut = mesh->faces[f].element[1] != DGFEM_NONE && check_random_int(&random, 4) < round % 4;
        volume = (double)dgfem_mesh_volume(mesh), area = (double)dgfem_mesh_boundary_area(mesh);
        for (limit = 1e-4 * volume; limit < 2 * volume; limit *= 4) {
            int before = mesh->element_count, small = 0, merged, left;
            check_status(dgfem_mesh_merge_slivers(mesh, (dgfem_real)limit, &merged, &left), DGFEM_OK);
            check_status(dgfem_mesh_check(mesh), DGFEM_OK);
            assert_int_equal(before - mesh->element_count, merged);
            check_near(dgfem_mesh_volume(mesh), volume, 512 * CHECK_EPSILON * volume);
            check_near(dgfem_mesh_boundary_area(mesh), area, 512 * CHECK_EPSILON * area);
            for (e = 0; e < mesh->element_count; e++) {
                if (!(mesh->elements[e].volume < (dgfem_real)limit)) continue;
                small++;
                for (i = 0; i < mesh->element_count; i++) assert_true(i == e || !mergeable(mesh, e, i));
            }
            assert_int_equal(small, left);
        }
        count_corners(mesh);
        dgfem_mesh_destroy(mesh);
    }
}

static void merge_refuses(void **state) {
    check_host host;
    dgfem_hooks hooks = check_hooks(&host);
    dgfem_mesh *mesh = box(2, 1, 1, &hooks);
    int merged = 7, left = 8;
    (void)state;
    check_status(dgfem_mesh_merge_slivers(NULL, 1, &merged, &left), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_mesh_merge_slivers(mesh, (dgfem_real)NAN, &merged, &left), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "volume nan");
    check_status(dgfem_mesh_merge_slivers(mesh, -1, &merged, &left), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "volume -1");
    check_status(dgfem_mesh_merge_slivers(mesh, (dgfem_real)INFINITY, &merged, &left), DGFEM_ERROR_ARGUMENT);
    assert_int_equal(merged, 7);
    assert_int_equal(left, 8);
    dgfem_mesh_destroy(mesh);
}

/* ---- the rest ---- */

static void faces_on_planes(void **state) {
    dgfem_mesh *mesh = box(2, 3, 4, NULL);
    dgfem_plane plane;
    int faces[12], i, side;
    (void)state;
    for (side = 0; side < 6; side++) {
        static const int counts[6] = {12, 12, 8, 8, 6, 6};
        int axis = side / 2;
        plane.normal = at(axis == 0, axis == 1, axis == 2);
        plane.offset = side % 2 ? (dgfem_real)(axis + 2) : 0;
        assert_int_equal(dgfem_mesh_faces_on_plane(mesh, plane, DGFEM_R(1e-6), faces, 12), counts[side]);
        for (i = 0; i < counts[side]; i++) assert_int_equal(mesh->faces[faces[i]].tag, side);
        faces[2] = -5;
        assert_int_equal(dgfem_mesh_faces_on_plane(mesh, plane, DGFEM_R(1e-6), faces, 2), counts[side]);
        assert_int_equal(faces[2], -5);
        assert_int_equal(dgfem_mesh_faces_on_plane(mesh, plane, DGFEM_R(1e-6), NULL, 0), counts[side]);
        plane.offset += DGFEM_R(0.01);
        assert_int_equal(dgfem_mesh_faces_on_plane(mesh, plane, DGFEM_R(1e-6), faces, 12), 0);
        assert_int_equal(dgfem_mesh_faces_on_plane(mesh, plane, DGFEM_R(0.02), faces, 12), counts[side]);
    }
    plane.normal = at(1, 0, 0), plane.offset = 1; /* inside: no boundary faces */
    assert_int_equal(dgfem_mesh_faces_on_plane(mesh, plane, DGFEM_R(1e-6), faces, 12), 0);
    plane.offset = (dgfem_real)NAN;
    assert_int_equal(dgfem_mesh_faces_on_plane(mesh, plane, 1, faces, 12), 0);
    assert_int_equal(dgfem_mesh_faces_on_plane(NULL, plane, 1, faces, 12), 0);
    dgfem_mesh_destroy(mesh);
}

static void copies_are_independent(void **state) {
    dgfem_mesh *mesh = rich_mesh(NULL), *copy, *second;
    (void)state;
    check_status(dgfem_mesh_copy(mesh, &copy), DGFEM_OK);
    check_status(dgfem_mesh_copy(mesh, &second), DGFEM_OK);
    same_mesh(mesh, copy);
    memset(mesh->vertices, 0, sizeof(dgfem_vec3));
    memset(mesh->faces, 0, sizeof(dgfem_face));
    memset(mesh->elements, 0, sizeof(dgfem_element));
    mesh->loops[0].start = mesh->loop_vertices[0] = mesh->element_faces[0] = -1;
    dgfem_mesh_destroy(mesh);
    same_mesh(copy, second);
    check_status(dgfem_mesh_check(copy), DGFEM_OK);
    check_status(dgfem_mesh_copy(copy, NULL), DGFEM_ERROR_ARGUMENT);
    dgfem_mesh_destroy(copy);
    dgfem_mesh_destroy(second);
    check_status(dgfem_mesh_copy(NULL, &copy), DGFEM_ERROR_ARGUMENT);
    assert_null(copy);
    dgfem_mesh_destroy(NULL);
    check_near(dgfem_mesh_volume(NULL), 0, 0);
    check_near(dgfem_mesh_boundary_area(NULL), 0, 0);
}

/* Appending from the pools themselves, while they move. */
static void pools_append_from_themselves(void **state) {
    dgfem_mesh *mesh = box(1, 1, 1, NULL);
    int i, k;
    (void)state;
    for (i = 0; i < 200; i++) {
        int from = i % mesh->loop_count, loop, element;
        int start = mesh->loops[from].start, count = mesh->loops[from].count;
        loop = dgfemi_mesh_add_loop(mesh, mesh->loop_vertices + start + 1, count - 1);
        assert_int_equal(loop, mesh->loop_count - 1);
        assert_int_equal(mesh->loops[loop].count, count - 1);
        for (k = 0; k < count - 1; k++)
            assert_int_equal(mesh->loop_vertices[mesh->loops[loop].start + k], mesh->loop_vertices[start + 1 + k]);
        if (count <= 3) mesh->loop_count--;
        element = dgfemi_mesh_add_element(mesh, mesh->element_faces, 6, 40 + i);
        assert_int_equal(element, i + 1);
        assert_int_equal(mesh->elements[element].tag, 40 + i);
        assert_memory_equal(mesh->element_faces + mesh->elements[element].face_start, mesh->element_faces,
                            6 * sizeof(int));
    }
    assert_int_equal(dgfemi_mesh_reserve(mesh, INT_MAX, 0, 0, 0, 0, 0), 0);
    assert_int_equal(dgfemi_mesh_reserve(mesh, 0, 0, 0, 0, 0, INT_MAX), 0);
    dgfem_mesh_destroy(mesh);
}

/* The middle of three cubes dies by hand. */
static void compact_drops_the_dead(void **state) {
    dgfem_mesh *mesh = box(3, 1, 1, NULL), *again;
    static const dgfem_vec3 normal = {1, 0, 0};
    int k, loop[4] = {0, 4, 8, 12}, f;
    (void)state;
    mesh->elements[0].tag = 70, mesh->elements[2].tag = 72;
    for (k = 6; k < 12; k++) {
        dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        int other = face->element[face->element[0] == 1];
        if (other == DGFEM_NONE) face->element[0] = DGFEM_NONE;
        else if (other == 0) face->element[1] = DGFEM_NONE;
        else {
            face->element[0] = 2, face->element[1] = DGFEM_NONE;
            face->normal = dgfemi_scale(-1, face->normal);
            reverse_loop(mesh, face->loop_start);
        }
    }
    mesh->elements[1].face_count = 0;
    /* garbage: a loop of no face, a face that died with its new vertex, an element that died with its list */
    assert_true(dgfemi_mesh_add_vertex(mesh, normal) == 16);
    assert_true(dgfemi_mesh_add_loop(mesh, loop, 4) >= 0);
    loop[0] = 16;
    f = dgfemi_mesh_add_face(mesh, dgfemi_mesh_add_loop(mesh, loop, 4), 1, DGFEM_NONE, DGFEM_NONE, 5, normal);
    k = dgfemi_mesh_add_element(mesh, &f, 1, 9);
    mesh->elements[k].face_count = 0;

    check_status(dgfemi_mesh_compact(mesh), DGFEM_OK);
    check_status(dgfem_mesh_check(mesh), DGFEM_OK);
    assert_int_equal(mesh->element_count, 2);
    assert_int_equal(mesh->face_count, 12);
    assert_int_equal(mesh->vertex_count, 16);
    assert_int_equal(mesh->loop_count, 12);
    assert_int_equal(mesh->loop_vertex_count, 48);
    assert_int_equal(mesh->element_face_count, 12);
    assert_int_equal(mesh->elements[0].tag, 70);
    assert_int_equal(mesh->elements[1].tag, 72);
    check_near3(mesh->elements[1].centre, at(2.5, 0.5, 0.5), 8 * CHECK_EPSILON);
    check_status(dgfem_mesh_copy(mesh, &again), DGFEM_OK);
    check_status(dgfemi_mesh_compact(again), DGFEM_OK); /* nothing more to do */
    same_mesh(mesh, again);
    dgfem_mesh_destroy(mesh);
    dgfem_mesh_destroy(again);
}

static void measures_of_slivers(void **state) {
    dgfem_mesh *mesh = box(1, 1, 1, NULL);
    const dgfem_vec3 up = {0, 0, 1};
    int v[4], loop, face;
    (void)state;
    v[0] = dgfemi_mesh_add_vertex(mesh, at(100, 0, 0));
    v[1] = dgfemi_mesh_add_vertex(mesh, at(101, 0, 0));
    v[2] = dgfemi_mesh_add_vertex(mesh, at(101, 0, 0.125)); /* upright: no area along `up` */
    v[3] = dgfemi_mesh_add_vertex(mesh, at(100, 0, 0.125));
    loop = dgfemi_mesh_add_loop(mesh, v, 4);
    face = dgfemi_mesh_add_face(mesh, loop, 1, 0, DGFEM_NONE, DGFEM_NONE, up);
    dgfemi_mesh_measure_face(mesh, face);
    check_near3(mesh->faces[face].normal, up, 0); /* kept */
    check_near(mesh->faces[face].area, 0, 0);
    check_near3(mesh->faces[face].centre, at(100.5, 0, 0.0625), 1e-30);
    mesh->faces[face].normal = at(0, 0, -1);
    mesh->vertices[v[2]].y = (dgfem_real)-1e-6; /* turned the other way round: still no negative area */
    dgfemi_mesh_measure_face(mesh, face);
    assert_true(mesh->faces[face].area >= 0);
    assert_true(mesh->faces[face].centre.x >= 100 && mesh->faces[face].centre.x <= 101);
    dgfem_mesh_destroy(mesh);
}

/* ---- no memory ---- */

static dgfem_status run_grid(void *context, const dgfem_hooks *hooks) {
    dgfem_grid_desc desc = box_desc(3, 2, 2, hooks);
    dgfem_mesh *mesh = (dgfem_mesh *)context;
    dgfem_status status = dgfem_mesh_create_grid(&desc, &mesh);
    assert_int_equal(mesh == NULL, status != DGFEM_OK);
    dgfem_mesh_destroy(mesh);
    return status;
}

static dgfem_status run_tetrahedra(void *context, const dgfem_hooks *hooks) {
    dgfem_tetrahedra_desc desc = kuhn_desc((const kuhn *)context, hooks);
    dgfem_mesh *mesh = NULL;
    dgfem_status status = dgfem_mesh_create_tetrahedra(&desc, &mesh);
    assert_int_equal(mesh == NULL, status != DGFEM_OK);
    dgfem_mesh_destroy(mesh);
    return status;
}

static dgfem_status run_polyhedra(void *context, const dgfem_hooks *hooks) {
    dgfem_weld_desc desc = dgfem_default_weld_desc();
    dgfem_mesh *mesh = NULL;
    dgfem_status status;
    desc.hooks = *hooks;
    status = dgfem_mesh_create_polyhedra((const dgfem_polyhedron *const *)context, 3, &desc, &mesh);
    assert_int_equal(mesh == NULL, status != DGFEM_OK);
    dgfem_mesh_destroy(mesh);
    return status;
}

/* What is done to a copy of `mesh` whose hooks are the given ones: it is unchanged where that fails. */
typedef struct edit {
    dgfem_mesh *mesh;
    dgfem_status (*run)(dgfem_mesh *mesh);
} edit;

static dgfem_status run_edit(void *context, const dgfem_hooks *hooks) {
    const edit *e = (const edit *)context;
    check_host *host = (check_host *)hooks->reallocate_user;
    const long fail_from = host->fail_from;
    dgfem_hooks original = e->mesh->hooks;
    dgfem_mesh *mesh;
    dgfem_status status;
    e->mesh->hooks = *hooks;
    host->fail_from = 0;
    check_status(dgfem_mesh_copy(e->mesh, &mesh), DGFEM_OK);
    e->mesh->hooks = original;
    host->fail_from = fail_from + host->calls; /* the copy does not count */
    status = e->run(mesh);
    host->calls -= host->fail_from - fail_from;
    if (status) same_mesh(mesh, e->mesh);
    dgfem_mesh_destroy(mesh);
    return status;
}

static dgfem_status edit_check(dgfem_mesh *mesh) { return dgfem_mesh_check(mesh); }
static dgfem_status edit_merge(dgfem_mesh *mesh) { return dgfem_mesh_merge_slivers(mesh, DGFEM_R(8.5), NULL, NULL); }
static dgfem_status edit_compact(dgfem_mesh *mesh) { return dgfemi_mesh_compact(mesh); }

static dgfem_status edit_copy(dgfem_mesh *mesh) {
    dgfem_mesh *copy;
    dgfem_status status = dgfem_mesh_copy(mesh, &copy);
    dgfem_mesh_destroy(copy);
    return status;
}

static dgfem_status edit_corners(dgfem_mesh *mesh) {
    dgfem_corners *corners;
    dgfem_status status = dgfem_mesh_corners(mesh, &corners);
    dgfem_corners_destroy(corners);
    return status;
}

static dgfem_status edit_polyhedron(dgfem_mesh *mesh) {
    dgfem_polyhedron *part;
    dgfem_status status = dgfem_mesh_element_polyhedron(mesh, 0, &part);
    dgfem_polyhedron_destroy(part);
    return status;
}

static void every_allocation_may_fail(void **state) {
    static dgfem_status (*const edits[])(dgfem_mesh * mesh) = {edit_check, edit_merge,   edit_compact,
                                                               edit_copy,  edit_corners, edit_polyhedron};
    kuhn k = kuhn_make(2);
    dgfem_polyhedron *parts[3];
    dgfem_mesh *mesh = rich_mesh(NULL);
    size_t i;
    (void)state;
    parts[0] = holed_block(0, 1);
    parts[1] = holed_block(1, 3);
    parts[2] = block(at(1, 1, 0), at(2, 2, 1));
    assert_true(check_every_allocation(run_grid, NULL) >= 7);
    assert_true(check_every_allocation(run_tetrahedra, &k) >= 10);
    assert_true(check_every_allocation(run_polyhedra, parts) >= 10);
    for (i = 0; i < sizeof edits / sizeof edits[0]; i++) {
        edit e;
        e.mesh = mesh;
        e.run = edits[i];
        assert_true(check_every_allocation(run_edit, &e) >= 1);
    }
    destroy_polyhedra(parts, 3);
    dgfem_mesh_destroy(mesh);
    kuhn_free(&k);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(grid_numbering),
        cmocka_unit_test(grid_refuses),
        cmocka_unit_test(measures_do_not_depend_on_the_place),
        cmocka_unit_test(meshes_of_any_size_and_place),
        cmocka_unit_test(tetrahedra_of_a_cube),
        cmocka_unit_test(tetrahedra_of_strided_points),
        cmocka_unit_test(tetrahedra_refused),
        cmocka_unit_test(polyhedra_with_holes),
        cmocka_unit_test(polyhedra_round_trip),
        cmocka_unit_test(polyhedra_that_do_not_conform_stay_apart),
        cmocka_unit_test(weld_tolerance),
        cmocka_unit_test(polyhedra_refused),
        cmocka_unit_test(element_polyhedron_refused),
        cmocka_unit_test(corners_by_hand),
        cmocka_unit_test(corners_of_random_cuts),
        cmocka_unit_test(corners_where_elements_only_touch),
        cmocka_unit_test(check_finds_every_corruption),
        cmocka_unit_test(check_of_edges_with_four_faces),
        cmocka_unit_test(merge_into_the_largest_face),
        cmocka_unit_test(merge_the_smallest_first),
        cmocka_unit_test(merge_without_neighbours),
        cmocka_unit_test(merge_everything),
        cmocka_unit_test(merge_keeps_edges_simple),
        cmocka_unit_test(merge_at_random),
        cmocka_unit_test(merge_refuses),
        cmocka_unit_test(faces_on_planes),
        cmocka_unit_test(copies_are_independent),
        cmocka_unit_test(pools_append_from_themselves),
        cmocka_unit_test(compact_drops_the_dead),
        cmocka_unit_test(measures_of_slivers),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
