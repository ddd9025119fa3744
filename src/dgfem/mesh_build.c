#pragma once
#include "mesh.c"
#include "polyhedron.c"
/* Meshes from boxes, tetrahedra and polyhedra; an element as a polyhedron. */

static void dgfemi_mesh_measure(dgfem_mesh *mesh) {
    int f, e;
    for (f = 0; f < mesh->face_count; f++) dgfemi_mesh_measure_face(mesh, f);
    for (e = 0; e < mesh->element_count; e++) dgfemi_mesh_measure_element(mesh, e);
}

/* ---- grid of boxes ---- */

DGFEM_API dgfem_grid_desc dgfem_default_grid_desc(void) {
    dgfem_grid_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.upper = dgfemi_vec3(1, 1, 1);
    desc.cells[0] = desc.cells[1] = desc.cells[2] = 1;
    return desc;
}

static dgfem_real dgfemi_grid_coordinate(const dgfem_grid_desc *desc, int axis, int i) {
    dgfem_real lower = dgfemi_axis(desc->lower, axis), upper = dgfemi_axis(desc->upper, axis);
    if (i == desc->cells[axis]) return upper;
    return lower + (upper - lower) * ((dgfem_real)i / (dgfem_real)desc->cells[axis]);
}

static dgfem_status dgfemi_grid_check_axis(const dgfem_grid_desc *desc, int axis) {
    dgfem_real lower = dgfemi_axis(desc->lower, axis), upper = dgfemi_axis(desc->upper, axis);
    int i;
    if (!dgfemi_is_finite(lower) || !dgfemi_is_finite(upper) || !dgfemi_is_finite(upper - lower))
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_NOT_FINITE, "grid, axis %c: from %g to %g", "xyz"[axis],
                           (double)lower, (double)upper);
    if (!(upper > lower))
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "grid, axis %c: upper %g is not above lower %g",
                           "xyz"[axis], (double)upper, (double)lower);
    for (i = 0; i < desc->cells[axis]; i++)
        if (!(dgfemi_grid_coordinate(desc, axis, i) < dgfemi_grid_coordinate(desc, axis, i + 1)))
            return dgfemi_fail(&desc->hooks, DGFEM_ERROR_DEGENERATE, "grid, axis %c: cell %d has no width", "xyz"[axis],
                               i);
    return DGFEM_OK;
}

static dgfem_status dgfemi_grid_check(const dgfem_grid_desc *desc) {
    const int *n = desc->cells;
    double nx = (double)n[0], ny = (double)n[1], nz = (double)n[2];
    double faces = (nx + 1) * ny * nz + nx * (ny + 1) * nz + nx * ny * (nz + 1);
    dgfem_status status = DGFEM_OK;
    dgfem_real volume = 1;
    int axis;
    for (axis = 0; axis < 3; axis++)
        if (n[axis] < 1)
            return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "grid, axis %c: %d cells", "xyz"[axis], n[axis]);
    if (4 * faces > (double)INT_MAX || 6 * nx * ny * nz > (double)INT_MAX)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "grid: %d x %d x %d cells have too many faces for int",
                           n[0], n[1], n[2]);
    for (axis = 0; !status && axis < 3; axis++) {
        status = dgfemi_grid_check_axis(desc, axis);
        volume *= (dgfemi_axis(desc->upper, axis) - dgfemi_axis(desc->lower, axis)) / (dgfem_real)n[axis];
    }
    if (!status && !(volume > 0 && dgfemi_is_finite(volume)))
        status = dgfemi_fail(&desc->hooks, DGFEM_ERROR_DEGENERATE, "grid: a cell of volume %g", (double)volume);
    return status;
}

/* Index of item (i,j,k) of a box of counts[0] * counts[1] * counts[2] items. */
static int dgfemi_grid_index(const int counts[3], const int ijk[3]) {
    return ijk[0] + counts[0] * (ijk[1] + counts[1] * ijk[2]);
}

static void dgfemi_grid_add_vertices(const dgfem_grid_desc *desc, dgfem_mesh *mesh) {
    int i, j, k;
    for (k = 0; k <= desc->cells[2]; k++)
        for (j = 0; j <= desc->cells[1]; j++)
            for (i = 0; i <= desc->cells[0]; i++)
                (void)dgfemi_mesh_add_vertex(mesh, dgfemi_vec3(dgfemi_grid_coordinate(desc, 0, i),
                                                               dgfemi_grid_coordinate(desc, 1, j),
                                                               dgfemi_grid_coordinate(desc, 2, k)));
}

/* The face at the lower side of cell ijk along an axis; ijk[axis] may be one past the last cell.

        k+1  3-----2       axis, u, v in cyclic order, so that 0 1 2 3 runs counter-clockwise seen from +axis
             |     |
          k  0-----1  v
             j u  j+1                                                                                              */
static void dgfemi_grid_add_face(const dgfem_grid_desc *desc, dgfem_mesh *mesh, int axis, const int ijk[3]) {
    int u = (axis + 1) % 3, v = (axis + 2) % 3, i, loop[4], points[3], below[3], above, element0, element1, tag;
    dgfem_real side = 1;
    for (i = 0; i < 3; i++) points[i] = desc->cells[i] + 1, below[i] = ijk[i];
    below[axis]--;
    for (i = 0; i < 4; i++) {
        int corner[3];
        corner[axis] = ijk[axis];
        corner[u] = ijk[u] + (i == 1 || i == 2);
        corner[v] = ijk[v] + (i >= 2);
        loop[i] = dgfemi_grid_index(points, corner);
    }
    above = ijk[axis] < desc->cells[axis] ? dgfemi_grid_index(desc->cells, ijk) : DGFEM_NONE;
    element0 = ijk[axis] > 0 ? dgfemi_grid_index(desc->cells, below) : DGFEM_NONE;
    element1 = above;
    tag = above == DGFEM_NONE ? 2 * axis + 1 : DGFEM_NONE;
    if (element0 == DGFEM_NONE) { /* lower side of the grid: the normal points out of the only element */
        int swap = loop[1];
        loop[1] = loop[3], loop[3] = swap;
        element0 = above, element1 = DGFEM_NONE;
        tag = 2 * axis;
        side = -1;
    }
    (void)dgfemi_mesh_add_face(mesh, dgfemi_mesh_add_loop(mesh, loop, 4), 1, element0, element1, tag,
                               dgfemi_vec3(axis == 0 ? side : 0, axis == 1 ? side : 0, axis == 2 ? side : 0));
}

/* All faces across an axis. Returns the index of the first. */
static int dgfemi_grid_add_faces(const dgfem_grid_desc *desc, dgfem_mesh *mesh, int axis) {
    int first = mesh->face_count, ijk[3];
    for (ijk[2] = 0; ijk[2] < desc->cells[2] + (axis == 2); ijk[2]++)
        for (ijk[1] = 0; ijk[1] < desc->cells[1] + (axis == 1); ijk[1]++)
            for (ijk[0] = 0; ijk[0] < desc->cells[0] + (axis == 0); ijk[0]++)
                dgfemi_grid_add_face(desc, mesh, axis, ijk);
    return first;
}

static void dgfemi_grid_add_elements(const dgfem_grid_desc *desc, dgfem_mesh *mesh, const int first_face[3]) {
    int ijk[3], faces[6], counts[3], axis;
    for (ijk[2] = 0; ijk[2] < desc->cells[2]; ijk[2]++)
        for (ijk[1] = 0; ijk[1] < desc->cells[1]; ijk[1]++)
            for (ijk[0] = 0; ijk[0] < desc->cells[0]; ijk[0]++) {
                for (axis = 0; axis < 3; axis++) {
                    memcpy(counts, desc->cells, sizeof counts);
                    counts[axis]++;
                    faces[2 * axis] = first_face[axis] + dgfemi_grid_index(counts, ijk);
                    ijk[axis]++;
                    faces[2 * axis + 1] = first_face[axis] + dgfemi_grid_index(counts, ijk);
                    ijk[axis]--;
                }
                (void)dgfemi_mesh_add_element(mesh, faces, 6, mesh->element_count);
            }
}

static dgfem_status dgfemi_mesh_grid(const dgfem_grid_desc *desc, dgfem_mesh **out) {
    int nx = desc->cells[0], ny = desc->cells[1], nz = desc->cells[2], axis, first_face[3];
    int cells = nx * ny * nz, faces = (nx + 1) * ny * nz + nx * (ny + 1) * nz + nx * ny * (nz + 1);
    dgfem_mesh *mesh = dgfemi_mesh_new(&desc->hooks);
    if (!mesh ||
        !dgfemi_mesh_reserve(mesh, (nx + 1) * (ny + 1) * (nz + 1), faces, cells, faces, 4 * faces, 6 * cells)) {
        dgfem_mesh_destroy(mesh);
        return dgfemi_fail_memory(&desc->hooks);
    }
    dgfemi_grid_add_vertices(desc, mesh);
    for (axis = 0; axis < 3; axis++) first_face[axis] = dgfemi_grid_add_faces(desc, mesh, axis);
    dgfemi_grid_add_elements(desc, mesh, first_face);
    dgfemi_mesh_measure(mesh);
    *out = mesh;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mesh_create_grid(const dgfem_grid_desc *desc, dgfem_mesh **out) {
    dgfem_status status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (out) *out = NULL;
    if (status) return status;
    if (!out) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "grid: nowhere to put the mesh");
    status = dgfemi_grid_check(desc);
    return status ? status : dgfemi_mesh_grid(desc, out);
}

/* ---- faces that two elements share ---- */

/* 1 when loop b runs through the vertices of loop a, in the same order (step 1) or the opposite one (step -1). */
static int dgfemi_loops_match(const int *a, const int *b, int count, int step) {
    int r, i;
    for (r = 0; r < count; r++) {
        int at = r;
        for (i = 0; i < count && a[i] == b[at]; i++) at = at + step < 0 ? count - 1 : (at + step) % count;
        if (i == count) return 1;
    }
    return 0;
}

/* The same for two ranges of mesh->loops, in any order. */
static int dgfemi_loop_sets_match(const dgfem_mesh *mesh, int first_a, int first_b, int count, int step) {
    int i, j;
    for (i = first_a; i < first_a + count; i++) {
        dgfem_loop a = mesh->loops[i];
        for (j = first_b; j < first_b + count; j++) {
            dgfem_loop b = mesh->loops[j];
            if (a.count == b.count &&
                dgfemi_loops_match(mesh->loop_vertices + a.start, mesh->loop_vertices + b.start, a.count, step))
                break;
        }
        if (j == first_b + count) return 0;
    }
    return 1;
}

/* Does not depend on the order of the loops, on where they start or which way they run. */
static uint64_t dgfemi_loops_hash(const dgfem_mesh *mesh, int first, int count) {
    uint64_t sum = 0;
    int l, i;
    for (l = first; l < first + count; l++) {
        const int *v = mesh->loop_vertices + mesh->loops[l].start;
        int last = v[mesh->loops[l].count - 1];
        for (i = 0; i < mesh->loops[l].count; i++) {
            sum += last < v[i] ? dgfemi_hash_pair(last, v[i]) : dgfemi_hash_pair(v[i], last);
            last = v[i];
        }
    }
    return dgfemi_mix(sum);
}

/* Elements given one after the other, each as a list of oriented faces. */
typedef struct dgfemi_mesh_builder {
    dgfem_mesh *mesh;
    const char *kind;     /* what the caller calls an element */
    dgfemi_buckets faces; /* by dgfemi_loops_hash */
    dgfemi_ints element;  /* faces of the element at work */
    int first_loop;       /* of the face at work */
} dgfemi_mesh_builder;

static void dgfemi_builder_free(dgfemi_mesh_builder *builder, const dgfem_hooks *hooks) {
    dgfemi_buckets_free(hooks, &builder->faces);
    dgfemi_free(hooks, builder->element.data);
    dgfem_mesh_destroy(builder->mesh);
}

/* The face whose loops match the loops at work either way, or DGFEM_NONE. */
static int dgfemi_builder_find(const dgfemi_mesh_builder *builder, uint64_t hash, int *step) {
    const dgfem_mesh *mesh = builder->mesh;
    int loop_count = mesh->loop_count - builder->first_loop, f;
    for (f = dgfemi_buckets_first(&builder->faces, hash); f != DGFEM_NONE; f = builder->faces.next[f]) {
        if (mesh->faces[f].loop_count != loop_count) continue;
        for (*step = -1; *step <= 1; *step += 2)
            if (dgfemi_loop_sets_match(mesh, mesh->faces[f].loop_start, builder->first_loop, loop_count, *step))
                return f;
    }
    return DGFEM_NONE;
}

/* The loops at work become the other side of an earlier face, or a new boundary face of the element to come. `side` is
   the caller's number of the face within its element. */
static dgfem_status dgfemi_builder_end_face(dgfemi_mesh_builder *builder, int side) {
    dgfem_mesh *mesh = builder->mesh;
    const dgfem_hooks *hooks = &mesh->hooks;
    int loop_count = mesh->loop_count - builder->first_loop, element = mesh->element_count, step = 0;
    uint64_t hash = dgfemi_loops_hash(mesh, builder->first_loop, loop_count);
    int f = dgfemi_builder_find(builder, hash, &step);
    if (f == DGFEM_NONE) {
        f = dgfemi_mesh_add_face(mesh, builder->first_loop, loop_count, element, DGFEM_NONE, DGFEM_NONE,
                                 dgfemi_vec3(0, 0, 0));
        if (f == DGFEM_NONE || !dgfemi_buckets_insert(hooks, &builder->faces, f, hash) ||
            !dgfemi_push(hooks, &builder->element, f))
            return dgfemi_fail_memory(hooks);
        mesh->faces[f].normal = dgfemi_mesh_unit_normal(mesh, f);
        if (!(dgfemi_dot(mesh->faces[f].normal, mesh->faces[f].normal) > 0))
            return dgfemi_fail(hooks, DGFEM_ERROR_DEGENERATE, "%s %d: face %d has no area", builder->kind, element,
                               side);
        return DGFEM_OK;
    }
    if (mesh->faces[f].element[0] == element || mesh->faces[f].element[1] == element)
        return dgfemi_fail(hooks, DGFEM_ERROR_DEGENERATE, "%s %d: face %d coincides with another of its faces",
                           builder->kind, element, side);
    if (mesh->faces[f].element[1] != DGFEM_NONE)
        return dgfemi_fail(hooks, DGFEM_ERROR_NOT_CONFORMING, "%s %d: face %d is already between %d and %d",
                           builder->kind, element, side, mesh->faces[f].element[0], mesh->faces[f].element[1]);
    if (step > 0)
        return dgfemi_fail(hooks, DGFEM_ERROR_NOT_CONFORMING, "%s %d: overlaps %d, on the same side of face %d",
                           builder->kind, element, mesh->faces[f].element[0], side);
    mesh->loop_vertex_count = mesh->loops[builder->first_loop].start;
    mesh->loop_count = builder->first_loop;
    mesh->faces[f].element[1] = element;
    return dgfemi_push(hooks, &builder->element, f) ? DGFEM_OK : dgfemi_fail_memory(hooks);
}

static dgfem_status dgfemi_builder_end_element(dgfemi_mesh_builder *builder) {
    dgfem_mesh *mesh = builder->mesh;
    if (dgfemi_mesh_add_element(mesh, builder->element.data, builder->element.count, mesh->element_count) == DGFEM_NONE)
        return dgfemi_fail_memory(&mesh->hooks);
    builder->element.count = 0;
    return DGFEM_OK;
}

/* ---- tetrahedra ---- */

DGFEM_API dgfem_tetrahedra_desc dgfem_default_tetrahedra_desc(void) {
    dgfem_tetrahedra_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.vertices = dgfemi_points_in(NULL, DGFEM_NUMBER_OF_REAL, 0);
    return desc;
}

static dgfem_status dgfemi_tetrahedron_check(const dgfem_tetrahedra_desc *desc, int t) {
    const int *v = desc->tetrahedra + 4 * t;
    dgfem_vec3 p[4];
    dgfem_real longest = 0, determinant;
    int i, j;
    for (i = 0; i < 4; i++)
        if (v[i] < 0 || v[i] >= desc->vertices.count)
            return dgfemi_fail(&desc->hooks, DGFEM_ERROR_INDEX, "tetrahedron %d refers to vertex %d of %d", t, v[i],
                               desc->vertices.count);
    for (i = 0; i < 4; i++) p[i] = dgfemi_point_read(&desc->vertices, v[i]);
    for (i = 0; i < 4; i++)
        for (j = 0; j < i; j++) longest = dgfemi_max(longest, dgfemi_distance(p[i], p[j]));
    determinant = dgfemi_dot(dgfemi_sub(p[1], p[0]), dgfemi_cross(dgfemi_sub(p[2], p[0]), dgfemi_sub(p[3], p[0])));
    if (!dgfemi_is_finite(determinant) || !dgfemi_is_finite(longest))
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_NOT_FINITE, "tetrahedron %d: its volume overflows", t);
    if (!(determinant > 16 * DGFEM_EPSILON * longest * longest * longest))
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_DEGENERATE, "tetrahedron %d is %s: volume %g", t,
                           determinant < 0 ? "inverted" : "flat", (double)determinant / 6);
    return DGFEM_OK;
}

static dgfem_status dgfemi_tetrahedra_check(const dgfem_tetrahedra_desc *desc) {
    const dgfem_points_in *vertices = &desc->vertices;
    dgfem_status status = dgfemi_check_points(&desc->hooks, vertices->data, vertices->type, vertices->stride,
                                              vertices->count, "tetrahedra, vertices");
    int i;
    if (status) return status;
    if (desc->tetrahedron_count < 0 || (desc->tetrahedron_count > 0 && !desc->tetrahedra))
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "tetrahedra: no indices for %d tetrahedra",
                           desc->tetrahedron_count);
    if (desc->tetrahedron_count == 0) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_EMPTY, "no tetrahedra");
    if (desc->tetrahedron_count > INT_MAX / 12)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "%d tetrahedra have too many faces for int",
                           desc->tetrahedron_count);
    for (i = 0; i < vertices->count; i++)
        if (!dgfemi_is_finite3(dgfemi_point_read(vertices, i)))
            return dgfemi_fail(&desc->hooks, DGFEM_ERROR_NOT_FINITE, "tetrahedra: vertex %d is not finite", i);
    for (i = 0; !status && i < desc->tetrahedron_count; i++) status = dgfemi_tetrahedron_check(desc, i);
    return status;
}

static dgfem_status dgfemi_tetrahedra_build(const dgfem_tetrahedra_desc *desc, dgfemi_mesh_builder *builder) {
    static const int sides[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}; /* side i lies opposite vertex i */
    dgfem_mesh *mesh = builder->mesh;
    int n = desc->tetrahedron_count, t, i, j;
    if (!dgfemi_mesh_reserve(mesh, desc->vertices.count, 0, n, 0, 0, 4 * n) ||
        !dgfemi_buckets_reset(&desc->hooks, &builder->faces, 4 * n))
        return dgfemi_fail_memory(&desc->hooks);
    for (i = 0; i < desc->vertices.count; i++)
        (void)dgfemi_mesh_add_vertex(mesh, dgfemi_point_read(&desc->vertices, i));
    for (t = 0; t < n; t++) {
        dgfem_status status = DGFEM_OK;
        for (i = 0; !status && i < 4; i++) {
            int loop[3];
            for (j = 0; j < 3; j++) loop[j] = desc->tetrahedra[4 * t + sides[i][j]];
            builder->first_loop = mesh->loop_count;
            status = dgfemi_mesh_add_loop(mesh, loop, 3) == DGFEM_NONE ? dgfemi_fail_memory(&desc->hooks)
                                                                       : dgfemi_builder_end_face(builder, i);
        }
        if (!status) status = dgfemi_builder_end_element(builder);
        if (status) return status;
    }
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mesh_create_tetrahedra(const dgfem_tetrahedra_desc *desc, dgfem_mesh **out) {
    dgfem_status status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    dgfemi_mesh_builder builder;
    if (out) *out = NULL;
    if (status) return status;
    if (!out) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "tetrahedra: nowhere to put the mesh");
    status = dgfemi_tetrahedra_check(desc);
    if (status) return status;
    memset(&builder, 0, sizeof builder);
    builder.kind = "tetrahedron";
    builder.mesh = dgfemi_mesh_new(&desc->hooks);
    status = builder.mesh ? dgfemi_tetrahedra_build(desc, &builder) : dgfemi_fail_memory(&desc->hooks);
    if (!status) {
        dgfemi_mesh_measure(builder.mesh);
        *out = builder.mesh;
        builder.mesh = NULL;
    }
    dgfemi_builder_free(&builder, &desc->hooks);
    return status;
}

/* ---- welding ---- */

/* Mesh vertices by the cell of a cubic lattice that they lie in. Cells are at least twice the tolerance wide, so that
   what is within the tolerance of a point lies in at most eight of them. */
typedef struct dgfemi_weld {
    dgfem_mesh *mesh;
    dgfemi_buckets cells;
    dgfem_vec3 origin;
    dgfem_real tolerance, width;
} dgfemi_weld;

static int dgfemi_weld_cell(const dgfemi_weld *weld, dgfem_real x) { return (int)floor((double)(x / weld->width)); }

static uint64_t dgfemi_weld_hash(int i, int j, int k) {
    return dgfemi_mix(dgfemi_hash_pair(i, j) + (uint64_t)(unsigned)k);
}

/* The mesh vertex closest to a point, if within the tolerance, else DGFEM_NONE. */
static int dgfemi_weld_find(const dgfemi_weld *weld, dgfem_vec3 point) {
    dgfem_vec3 p = dgfemi_sub(point, weld->origin);
    dgfem_real t = weld->tolerance, closest = t;
    int i, j, k, v, found = DGFEM_NONE;
    for (k = dgfemi_weld_cell(weld, p.z - t); k <= dgfemi_weld_cell(weld, p.z + t); k++)
        for (j = dgfemi_weld_cell(weld, p.y - t); j <= dgfemi_weld_cell(weld, p.y + t); j++)
            for (i = dgfemi_weld_cell(weld, p.x - t); i <= dgfemi_weld_cell(weld, p.x + t); i++)
                for (v = dgfemi_buckets_first(&weld->cells, dgfemi_weld_hash(i, j, k)); v != DGFEM_NONE;
                     v = weld->cells.next[v]) {
                    dgfem_real d = dgfemi_distance(weld->mesh->vertices[v], point);
                    if (!(d <= closest) || (found != DGFEM_NONE && !(d < closest) && v >= found)) continue;
                    closest = d;
                    found = v;
                }
    return found;
}

/* The mesh vertex for a point, a new one where none is close; DGFEM_NONE when out of memory. */
static int dgfemi_weld_vertex(dgfemi_weld *weld, dgfem_vec3 point) {
    dgfem_vec3 p = dgfemi_sub(point, weld->origin);
    uint64_t hash =
        dgfemi_weld_hash(dgfemi_weld_cell(weld, p.x), dgfemi_weld_cell(weld, p.y), dgfemi_weld_cell(weld, p.z));
    int v = dgfemi_weld_find(weld, point);
    if (v != DGFEM_NONE) return v;
    v = dgfemi_mesh_add_vertex(weld->mesh, point);
    if (v == DGFEM_NONE) return v;
    return dgfemi_buckets_insert(&weld->mesh->hooks, &weld->cells, v, hash) ? v : DGFEM_NONE;
}

/* ---- polyhedra ---- */

#if DGFEM_REAL_IS_FLOAT
#define DGFEM_WELD_TOLERANCE DGFEM_R(1e-5)
#else
#define DGFEM_WELD_TOLERANCE DGFEM_R(1e-9)
#endif

DGFEM_API dgfem_weld_desc dgfem_default_weld_desc(void) {
    dgfem_weld_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.tolerance = DGFEM_WELD_TOLERANCE;
    return desc;
}

/* Puts the number of the polyhedron behind a message about it. */
typedef struct dgfemi_numbered_log {
    const dgfem_hooks *hooks;
    int number;
} dgfemi_numbered_log;

static void dgfemi_log_numbered(void *user, dgfem_log_level level, const char *text) {
    const dgfemi_numbered_log *log = (const dgfemi_numbered_log *)user;
    char line[600];
    snprintf(line, sizeof line, "%s (polyhedron %d)", text, log->number);
    log->hooks->log(log->hooks->log_user, level, line);
}

/* The check of one polyhedron, with the hooks of the mesh. Planar means at least to round-off and to the default
   tolerance, however fine the welding. */
static dgfem_status dgfemi_weld_check_polyhedron(const dgfem_polyhedron *polyhedron, int number,
                                                 const dgfem_weld_desc *desc) {
    dgfemi_numbered_log log;
    dgfem_polyhedron view;
    if (!polyhedron) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "polyhedron %d is NULL", number);
    view = *polyhedron;
    log.hooks = &desc->hooks;
    log.number = number;
    view.hooks = desc->hooks;
    if (desc->hooks.log) view.hooks.log = dgfemi_log_numbered, view.hooks.log_user = &log;
    return dgfem_polyhedron_check(&view, dgfemi_max(desc->tolerance, DGFEM_WELD_TOLERANCE));
}

/* Sizes and common bounding box of all polyhedra. */
static dgfem_status dgfemi_weld_measure(const dgfem_polyhedron *const *polyhedra, int count,
                                        const dgfem_weld_desc *desc, dgfemi_weld *weld, double *faces,
                                        double *vertices) {
    dgfem_vec3 lower = dgfemi_vec3(0, 0, 0), upper = lower, extent;
    dgfem_real largest;
    int p;
    for (p = 0; p < count; p++) {
        dgfem_measure measure = dgfem_polyhedron_measure(polyhedra[p]);
        lower = p ? dgfemi_min3(lower, measure.lower) : measure.lower;
        upper = p ? dgfemi_max3(upper, measure.upper) : measure.upper;
        *faces += (double)polyhedra[p]->face_count;
        *vertices += (double)polyhedra[p]->vertex_count;
    }
    if (*faces > (double)INT_MAX || *vertices > (double)INT_MAX)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "%d polyhedra have too many faces for int", count);
    extent = dgfemi_sub(upper, lower);
    largest = dgfemi_max(extent.x, dgfemi_max(extent.y, extent.z));
    if (!dgfemi_is_finite3(extent))
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_NOT_FINITE, "polyhedra: their bounding box overflows");
    weld->origin = lower;
    weld->tolerance = desc->tolerance * largest;
    weld->width = dgfemi_max(2 * weld->tolerance, largest * DGFEM_R(1e-9)); /* keeps cell numbers within int */
    return DGFEM_OK;
}

/* Appends one welded loop of a polyhedron; `map` is from its vertices to the mesh's, DGFEM_NONE where unknown. */
static dgfem_status dgfemi_weld_loop(dgfemi_weld *weld, const dgfem_polyhedron *polyhedron, int loop, int *map,
                                     int *scratch, int number) {
    const dgfem_hooks *hooks = &weld->mesh->hooks;
    const int *v = polyhedron->loop_vertices + polyhedron->loop_start[loop];
    int count = polyhedron->loop_start[loop + 1] - polyhedron->loop_start[loop], i;
    for (i = 0; i < count; i++) {
        if (map[v[i]] == DGFEM_NONE) map[v[i]] = dgfemi_weld_vertex(weld, polyhedron->vertices[v[i]]);
        if (map[v[i]] == DGFEM_NONE) return dgfemi_fail_memory(hooks);
        scratch[i] = map[v[i]];
    }
    for (i = 0; i < count; i++) {
        int next = (i + 1) % count, after = (i + 2) % count;
        if (scratch[i] == scratch[next] || scratch[i] == scratch[after])
            return dgfemi_fail(hooks, DGFEM_ERROR_DEGENERATE,
                               "polyhedron %d: welding within %g joins vertices %d and %d of one face", number,
                               (double)weld->tolerance, v[i], scratch[i] == scratch[next] ? v[next] : v[after]);
    }
    return dgfemi_mesh_add_loop(weld->mesh, scratch, count) == DGFEM_NONE ? dgfemi_fail_memory(hooks) : DGFEM_OK;
}

static dgfem_status dgfemi_weld_polyhedron(dgfemi_weld *weld, dgfemi_mesh_builder *builder,
                                           const dgfem_polyhedron *polyhedron, int *map, int *scratch) {
    int number = builder->mesh->element_count, f, l, v;
    dgfem_status status = DGFEM_OK;
    for (v = 0; v < polyhedron->vertex_count; v++) map[v] = DGFEM_NONE;
    for (f = 0; !status && f < polyhedron->face_count; f++) {
        builder->first_loop = builder->mesh->loop_count;
        for (l = polyhedron->face_loops[f]; !status && l < polyhedron->face_loops[f + 1]; l++)
            status = dgfemi_weld_loop(weld, polyhedron, l, map, scratch, number);
        if (!status) status = dgfemi_builder_end_face(builder, f);
    }
    return status ? status : dgfemi_builder_end_element(builder);
}

static dgfem_status dgfemi_weld_build(const dgfem_polyhedron *const *polyhedra, int count, const dgfem_weld_desc *desc,
                                      dgfemi_weld *weld, dgfemi_mesh_builder *builder) {
    dgfemi_arena arena = dgfemi_arena_make(&desc->hooks);
    double faces = 0, vertices = 0;
    size_t most_vertices = 0, most_corners = 0;
    int *map, *scratch, p;
    dgfem_status status = dgfemi_weld_measure(polyhedra, count, desc, weld, &faces, &vertices);
    if (status) return status;
    for (p = 0; p < count; p++) {
        size_t n = (size_t)polyhedra[p]->vertex_count;
        size_t corners = (size_t)polyhedra[p]->loop_start[polyhedra[p]->face_loops[polyhedra[p]->face_count]];
        if (n > most_vertices) most_vertices = n;
        if (corners > most_corners) most_corners = corners;
    }
    map = (int *)dgfemi_arena_allocate(&arena, most_vertices, sizeof(int));
    scratch = (int *)dgfemi_arena_allocate(&arena, most_corners, sizeof(int));
    if (!map || !scratch || !dgfemi_buckets_reset(&desc->hooks, &builder->faces, (int)faces) ||
        !dgfemi_buckets_reset(&desc->hooks, &weld->cells, (int)vertices))
        status = dgfemi_fail_memory(&desc->hooks);
    for (p = 0; !status && p < count; p++) status = dgfemi_weld_polyhedron(weld, builder, polyhedra[p], map, scratch);
    dgfemi_arena_free(&arena);
    if (status) return status;
    dgfemi_mesh_measure(builder->mesh);
    for (p = 0; p < count; p++)
        if (!(builder->mesh->elements[p].volume > 0))
            return dgfemi_fail(&desc->hooks, DGFEM_ERROR_DEGENERATE, "polyhedron %d: volume %g after welding", p,
                               (double)builder->mesh->elements[p].volume);
    return DGFEM_OK;
}

static dgfem_status dgfemi_weld_check(const dgfem_polyhedron *const *polyhedra, int count,
                                      const dgfem_weld_desc *desc) {
    dgfem_status status = DGFEM_OK;
    int p;
    if (count < 0 || (count > 0 && !polyhedra))
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "polyhedra: no array of %d polyhedra", count);
    if (count == 0) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_EMPTY, "no polyhedra");
    if (!(desc->tolerance >= 0 && desc->tolerance <= DGFEM_R(0.1)))
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "weld tolerance %g is not in 0 .. 0.1",
                           (double)desc->tolerance);
    for (p = 0; !status && p < count; p++) status = dgfemi_weld_check_polyhedron(polyhedra[p], p, desc);
    return status;
}

DGFEM_API dgfem_status dgfem_mesh_create_polyhedra(const dgfem_polyhedron *const *polyhedra, int count,
                                                   const dgfem_weld_desc *desc, dgfem_mesh **out) {
    dgfem_status status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    dgfemi_mesh_builder builder;
    dgfemi_weld weld;
    if (out) *out = NULL;
    if (status) return status;
    if (!out) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "polyhedra: nowhere to put the mesh");
    status = dgfemi_weld_check(polyhedra, count, desc);
    if (status) return status;
    memset(&builder, 0, sizeof builder);
    memset(&weld, 0, sizeof weld);
    builder.kind = "polyhedron";
    builder.mesh = weld.mesh = dgfemi_mesh_new(&desc->hooks);
    status =
        builder.mesh ? dgfemi_weld_build(polyhedra, count, desc, &weld, &builder) : dgfemi_fail_memory(&desc->hooks);
    if (!status) {
        *out = builder.mesh;
        builder.mesh = NULL;
    }
    dgfemi_buckets_free(&desc->hooks, &weld.cells);
    dgfemi_builder_free(&builder, &desc->hooks);
    return status;
}

/* ---- an element as a polyhedron ---- */

static int dgfemi_compare_ints(const void *a, const void *b) {
    int x = *(const int *)a, y = *(const int *)b;
    return (x > y) - (x < y);
}

/* Sorts and drops repeats; returns the new count. */
static int dgfemi_sort_unique(int *data, int count) {
    int i, kept = 0;
    qsort(data, (size_t)count, sizeof(int), dgfemi_compare_ints);
    for (i = 0; i < count; i++)
        if (kept == 0 || data[i] != data[kept - 1]) data[kept++] = data[i];
    return kept;
}

/* The arrays of a polyhedron at work. */
typedef struct dgfemi_outline {
    int *ids; /* mesh vertices, ascending: ids[i] becomes vertex i */
    dgfem_vec3 *vertices;
    int *face_loops, *loop_start, *loop_vertices;
    int vertex_count, loop_count, corner_count;
} dgfemi_outline;

static int dgfemi_outline_allocate(const dgfem_mesh *mesh, const dgfem_element *element, dgfemi_arena *arena,
                                   dgfemi_outline *outline) {
    size_t loops = 0, corners = 0;
    int k, l;
    for (k = element->face_start; k < element->face_start + element->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        loops += (size_t)face->loop_count;
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            corners += (size_t)mesh->loops[l].count;
    }
    memset(outline, 0, sizeof *outline);
    outline->ids = (int *)dgfemi_arena_allocate(arena, corners, sizeof(int));
    outline->vertices = (dgfem_vec3 *)dgfemi_arena_allocate(arena, corners, sizeof(dgfem_vec3));
    outline->face_loops = (int *)dgfemi_arena_allocate(arena, (size_t)element->face_count + 1, sizeof(int));
    outline->loop_start = (int *)dgfemi_arena_allocate(arena, loops + 1, sizeof(int));
    outline->loop_vertices = (int *)dgfemi_arena_allocate(arena, corners, sizeof(int));
    return outline->ids && outline->vertices && outline->face_loops && outline->loop_start && outline->loop_vertices;
}

/* Loops are copied as seen from outside the element; a reversed loop keeps its first vertex, so that fans agree. */
static void dgfemi_outline_fill(const dgfem_mesh *mesh, int e, dgfemi_outline *outline) {
    const dgfem_element *element = &mesh->elements[e];
    int k, l, i;
    outline->face_loops[0] = outline->loop_start[0] = 0;
    for (k = 0; k < element->face_count; k++) {
        int f = mesh->element_faces[element->face_start + k], sign = dgfemi_mesh_sign(mesh, e, f);
        const dgfem_face *face = &mesh->faces[f];
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
            const int *v = mesh->loop_vertices + mesh->loops[l].start;
            int count = mesh->loops[l].count;
            for (i = 0; i < count; i++)
                outline->loop_vertices[outline->corner_count++] = sign > 0 || i == 0 ? v[i] : v[count - i];
            outline->loop_start[++outline->loop_count] = outline->corner_count;
        }
        outline->face_loops[k + 1] = outline->loop_count;
    }
    memcpy(outline->ids, outline->loop_vertices, (size_t)outline->corner_count * sizeof(int));
    outline->vertex_count = dgfemi_sort_unique(outline->ids, outline->corner_count);
    for (i = 0; i < outline->vertex_count; i++) outline->vertices[i] = mesh->vertices[outline->ids[i]];
    for (i = 0; i < outline->corner_count; i++) {
        const int *found = (const int *)bsearch(&outline->loop_vertices[i], outline->ids, (size_t)outline->vertex_count,
                                                sizeof(int), dgfemi_compare_ints);
        outline->loop_vertices[i] = (int)(found - outline->ids);
    }
}

DGFEM_API dgfem_status dgfem_mesh_element_polyhedron(const dgfem_mesh *mesh, int element, dgfem_polyhedron **out) {
    dgfem_polyhedron_desc desc = dgfem_default_polyhedron_desc();
    dgfemi_outline outline;
    dgfemi_arena arena;
    dgfem_status status;
    if (out) *out = NULL;
    if (!mesh) return DGFEM_ERROR_ARGUMENT;
    if (!out) return dgfemi_fail(&mesh->hooks, DGFEM_ERROR_ARGUMENT, "nowhere to put the polyhedron");
    if (element < 0 || element >= mesh->element_count)
        return dgfemi_fail(&mesh->hooks, DGFEM_ERROR_INDEX, "element %d of %d", element, mesh->element_count);
    arena = dgfemi_arena_make(&mesh->hooks);
    if (dgfemi_outline_allocate(mesh, &mesh->elements[element], &arena, &outline)) {
        dgfemi_outline_fill(mesh, element, &outline);
        desc.vertices = outline.vertices;
        desc.vertex_count = outline.vertex_count;
        desc.face_count = mesh->elements[element].face_count;
        desc.face_loops = outline.face_loops;
        desc.loop_start = outline.loop_start;
        desc.loop_vertices = outline.loop_vertices;
        desc.hooks = mesh->hooks;
        status = dgfem_polyhedron_create(&desc, out);
    } else {
        status = dgfemi_fail_memory(&mesh->hooks);
    }
    dgfemi_arena_free(&arena);
    return status;
}
