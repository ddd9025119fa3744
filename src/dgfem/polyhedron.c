#pragma once
#include "moments.c"
#include "planar.c"
/* The stand-alone polyhedron: creation, check, measure, contains, moments, triangles of its faces, components. */

/* ---- creation ---- */

DGFEM_API dgfem_polyhedron_desc dgfem_default_polyhedron_desc(void) {
    dgfem_polyhedron_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    return desc;
}

/* A polyhedron with room for these numbers of things, its arrays not yet filled; NULL when out of memory. */
static dgfem_polyhedron *dgfemi_polyhedron_allocate(const dgfem_hooks *hooks, int vertices, int faces, int loops,
                                                    int corners) {
    dgfem_polyhedron *p = (dgfem_polyhedron *)dgfemi_allocate_zero(hooks, 1, sizeof *p);
    if (!p) return NULL;
    p->hooks = *hooks;
    p->vertex_count = vertices;
    p->face_count = faces;
    p->vertices = (dgfem_vec3 *)dgfemi_allocate(hooks, (size_t)vertices, sizeof *p->vertices);
    p->face_loops = (int *)dgfemi_allocate(hooks, (size_t)faces + 1, sizeof(int));
    p->loop_start = (int *)dgfemi_allocate(hooks, (size_t)loops + 1, sizeof(int));
    p->loop_vertices = (int *)dgfemi_allocate(hooks, (size_t)corners, sizeof(int));
    if (p->vertices && p->face_loops && p->loop_start && p->loop_vertices) return p;
    dgfem_polyhedron_destroy(p);
    return NULL;
}

DGFEM_API void dgfem_polyhedron_destroy(dgfem_polyhedron *polyhedron) {
    dgfem_hooks hooks;
    if (!polyhedron) return;
    hooks = polyhedron->hooks;
    dgfemi_free(&hooks, polyhedron->vertices);
    dgfemi_free(&hooks, polyhedron->face_loops);
    dgfemi_free(&hooks, polyhedron->loop_start);
    dgfemi_free(&hooks, polyhedron->loop_vertices);
    dgfemi_free(&hooks, polyhedron);
}

static dgfem_status dgfemi_check_polyhedron_faces(const dgfem_polyhedron_desc *desc, int *loop_count) {
    int f;
    *loop_count = desc->face_count;
    if (!desc->face_loops) return DGFEM_OK;
    if (desc->face_loops[0] != 0)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "face_loops starts with %d, not 0", desc->face_loops[0]);
    for (f = 0; f < desc->face_count; f++)
        if (desc->face_loops[f + 1] <= desc->face_loops[f])
            return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "face %d has no loop: face_loops goes from %d to %d",
                               f, desc->face_loops[f], desc->face_loops[f + 1]);
    *loop_count = desc->face_loops[desc->face_count];
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_polyhedron_loop(const dgfem_polyhedron_desc *desc, int l) {
    const int start = desc->loop_start[l], end = desc->loop_start[l + 1];
    int i;
    if (end < start)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "loop %d: loop_start goes from %d to %d", l, start, end);
    if (end - start < 3)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_DEGENERATE, "loop %d has %d vertices", l, end - start);
    for (i = start; i < end; i++) {
        const int vertex = desc->loop_vertices[i], next = desc->loop_vertices[i + 1 < end ? i + 1 : start];
        if (vertex < 0 || vertex >= desc->vertex_count)
            return dgfemi_fail(&desc->hooks, DGFEM_ERROR_INDEX, "loop %d has vertex %d of %d", l, vertex,
                               desc->vertex_count);
        if (vertex == next)
            return dgfemi_fail(&desc->hooks, DGFEM_ERROR_DEGENERATE, "loop %d has vertex %d twice in a row", l, vertex);
    }
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_polyhedron_desc(const dgfem_polyhedron_desc *desc, int *loop_count) {
    const dgfem_hooks *hooks = &desc->hooks;
    dgfem_status status;
    int v, l;
    if (desc->vertex_count < 0 || desc->face_count < 0)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "polyhedron: negative number of vertices (%d) or faces (%d)",
                           desc->vertex_count, desc->face_count);
    if (desc->vertex_count == 0 || desc->face_count == 0)
        return dgfemi_fail(hooks, DGFEM_ERROR_EMPTY, "polyhedron of %d vertices and %d faces", desc->vertex_count,
                           desc->face_count);
    if (!desc->vertices || !desc->loop_start || !desc->loop_vertices)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "polyhedron: vertices, loop_start or loop_vertices is NULL");
    for (v = 0; v < desc->vertex_count; v++)
        if (!dgfemi_is_finite3(desc->vertices[v])) return dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "vertex %d", v);
    status = dgfemi_check_polyhedron_faces(desc, loop_count);
    if (status) return status;
    if (desc->loop_start[0] != 0)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "loop_start starts with %d, not 0", desc->loop_start[0]);
    for (l = 0; l < *loop_count; l++) {
        status = dgfemi_check_polyhedron_loop(desc, l);
        if (status) return status;
    }
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_polyhedron_create(const dgfem_polyhedron_desc *desc, dgfem_polyhedron **out) {
    dgfem_polyhedron *p;
    dgfem_status status;
    int loop_count = 0, corners, f;
    if (out) *out = NULL;
    status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (status) return status;
    if (!out) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "polyhedron: nowhere to put it");
    status = dgfemi_check_polyhedron_desc(desc, &loop_count);
    if (status) return status;
    corners = desc->loop_start[loop_count];
    p = dgfemi_polyhedron_allocate(&desc->hooks, desc->vertex_count, desc->face_count, loop_count, corners);
    if (!p) return dgfemi_fail_memory(&desc->hooks);
    memcpy(p->vertices, desc->vertices, (size_t)desc->vertex_count * sizeof *p->vertices);
    memcpy(p->loop_start, desc->loop_start, (size_t)(loop_count + 1) * sizeof(int));
    memcpy(p->loop_vertices, desc->loop_vertices, (size_t)corners * sizeof(int));
    for (f = 0; f <= desc->face_count; f++) p->face_loops[f] = desc->face_loops ? desc->face_loops[f] : f;
    *out = p;
    return DGFEM_OK;
}

/* ---- faces ---- */

static const int *dgfemi_polyhedron_loop(const dgfem_polyhedron *p, int loop, int *count) {
    *count = p->loop_start[loop + 1] - p->loop_start[loop];
    return p->loop_vertices + p->loop_start[loop];
}

/* Twice the vector area of a face. */
static dgfem_vec3 dgfemi_polyhedron_vector_area(const dgfem_polyhedron *p, int face) {
    dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
    int l, count;
    for (l = p->face_loops[face]; l < p->face_loops[face + 1]; l++) {
        const int *loop = dgfemi_polyhedron_loop(p, l, &count);
        sum = dgfemi_add(sum, dgfemi_loop_vector_area(p->vertices, loop, count));
    }
    return sum;
}

/* First corner of a face, and one past its last. */
static int dgfemi_polyhedron_first_corner(const dgfem_polyhedron *p, int face) {
    return p->loop_start[p->face_loops[face]];
}

/* The box of the vertices that occur in loops. */
static void dgfemi_polyhedron_box(const dgfem_polyhedron *p, dgfem_vec3 *lower, dgfem_vec3 *upper) {
    const int corners = dgfemi_polyhedron_first_corner(p, p->face_count);
    int i;
    *lower = *upper = p->vertices[p->loop_vertices[0]];
    for (i = 1; i < corners; i++) {
        *lower = dgfemi_min3(*lower, p->vertices[p->loop_vertices[i]]);
        *upper = dgfemi_max3(*upper, p->vertices[p->loop_vertices[i]]);
    }
}

/* ---- moments ---- */

/* A length scale for moments about the centre: the largest coordinate difference; 1 if all are zero. In double any will
   do, since no power of a sensible length overflows. */
static dgfem_real dgfemi_polyhedron_reach(const dgfem_polyhedron *p, dgfem_vec3 centre, int first_face, int end_face) {
#if DGFEM_REAL_IS_FLOAT
    const int end = dgfemi_polyhedron_first_corner(p, end_face);
    dgfem_real reach = 0;
    int i;
    for (i = dgfemi_polyhedron_first_corner(p, first_face); i < end; i++) {
        const dgfem_vec3 d = dgfemi_sub(p->vertices[p->loop_vertices[i]], centre);
        reach = dgfemi_max(reach, dgfemi_max(dgfemi_abs(d.x), dgfemi_max(dgfemi_abs(d.y), dgfemi_abs(d.z))));
    }
    return reach > 0 && dgfemi_is_finite(reach) ? reach : 1;
#else
    (void)p, (void)centre, (void)first_face, (void)end_face;
    return 1;
#endif
}

static void dgfemi_polyhedron_add_face(const dgfem_polyhedron *p, int face, dgfemi_moments *moments) {
    int l, count;
    for (l = p->face_loops[face]; l < p->face_loops[face + 1]; l++) {
        const int *loop = dgfemi_polyhedron_loop(p, l, &count);
        dgfemi_moments_loop(moments, p->vertices, loop, count, 0);
    }
}

static void dgfemi_polyhedron_moments(const dgfem_polyhedron *p, int degree, dgfem_vec3 centre, dgfem_real *out) {
    dgfemi_moments moments;
    int f;
    dgfemi_moments_begin_volume(&moments, degree, centre, dgfemi_polyhedron_reach(p, centre, 0, p->face_count));
    dgfemi_moments_unscaled(&moments);
    for (f = 0; f < p->face_count; f++) dgfemi_polyhedron_add_face(p, f, &moments);
    dgfemi_moments_end(&moments, out);
}

static void dgfemi_polyhedron_face_moments(const dgfem_polyhedron *p, int face, int degree, dgfem_vec3 centre,
                                           dgfem_real *out) {
    const dgfem_vec3 normal = dgfemi_normalized(dgfemi_polyhedron_vector_area(p, face));
    dgfemi_moments moments;
    dgfemi_moments_begin_face(&moments, degree, centre, dgfemi_polyhedron_reach(p, centre, face, face + 1), normal);
    dgfemi_moments_unscaled(&moments);
    dgfemi_polyhedron_add_face(p, face, &moments);
    dgfemi_moments_end(&moments, out);
}

static dgfem_status dgfemi_check_moments_call(const dgfem_polyhedron *p, int degree, dgfem_vec3 centre,
                                              const dgfem_real *out) {
    if (!p) return DGFEM_ERROR_ARGUMENT;
    if (!out) return dgfemi_fail(&p->hooks, DGFEM_ERROR_ARGUMENT, "moments: nowhere to put them");
    if (degree < 0 || degree > DGFEM_MAX_MOMENT_DEGREE)
        return dgfemi_fail(&p->hooks, DGFEM_ERROR_ARGUMENT, "moments of degree %d; 0..%d can be had", degree,
                           DGFEM_MAX_MOMENT_DEGREE);
    if (!dgfemi_is_finite3(centre)) return dgfemi_fail(&p->hooks, DGFEM_ERROR_NOT_FINITE, "centre of the moments");
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_face_index(const dgfem_polyhedron *p, int face) {
    if (face >= 0 && face < p->face_count) return DGFEM_OK;
    return dgfemi_fail(&p->hooks, DGFEM_ERROR_INDEX, "face %d of %d", face, p->face_count);
}

DGFEM_API dgfem_status dgfem_polyhedron_moments(const dgfem_polyhedron *polyhedron, int degree, dgfem_vec3 centre,
                                                dgfem_real *out) {
    const dgfem_status status = dgfemi_check_moments_call(polyhedron, degree, centre, out);
    if (status) return status;
    dgfemi_polyhedron_moments(polyhedron, degree, centre, out);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_polyhedron_face_moments(const dgfem_polyhedron *polyhedron, int face, int degree,
                                                     dgfem_vec3 centre, dgfem_real *out) {
    dgfem_status status = dgfemi_check_moments_call(polyhedron, degree, centre, out);
    if (!status) status = dgfemi_check_face_index(polyhedron, face);
    if (status) return status;
    dgfemi_polyhedron_face_moments(polyhedron, face, degree, centre, out);
    return DGFEM_OK;
}

DGFEM_API dgfem_measure dgfem_polyhedron_measure(const dgfem_polyhedron *polyhedron) {
    dgfem_measure measure;
    dgfem_real moments[4];
    dgfem_vec3 centre;
    int f;
    memset(&measure, 0, sizeof measure);
    if (!polyhedron) return measure;
    dgfemi_polyhedron_box(polyhedron, &measure.lower, &measure.upper);
    centre = dgfemi_add_scaled(measure.lower, DGFEM_R(0.5), dgfemi_sub(measure.upper, measure.lower));
    dgfemi_polyhedron_moments(polyhedron, 1, centre, moments);
    measure.volume = moments[0];
    measure.centroid = centre;
    if (measure.volume != 0)
        measure.centroid =
            dgfemi_add(centre, dgfemi_vec3(moments[1] / moments[0], moments[2] / moments[0], moments[3] / moments[0]));
    for (f = 0; f < polyhedron->face_count; f++)
        measure.area += dgfemi_norm(dgfemi_polyhedron_vector_area(polyhedron, f)) / 2;
    return measure;
}

/* ---- contains ---- */

/* How often the surface of one face, hit from inside minus from outside, lies straight above a point (direction +z).

   Whether the vertical line hits is decided exactly in the x-y projection, edge by edge, so that faces that share an
   edge agree: hits are neither doubled nor lost, wherever the point is. What remains is whether the hit lies above;
   outside of the face's own range of z that is plain, and inside it an error can only occur next to the surface. */
static int dgfemi_polyhedron_hits_above(const dgfem_polyhedron *p, int face, dgfem_vec3 point) {
    const int first = dgfemi_polyhedron_first_corner(p, face), end = dgfemi_polyhedron_first_corner(p, face + 1);
    const double q[2] = {(double)point.x, (double)point.y};
    dgfem_real lower = p->vertices[p->loop_vertices[first]].z, upper = lower;
    dgfem_vec3 normal;
    int winding = 0, l, i;
    for (i = first + 1; i < end; i++) {
        lower = dgfemi_min(lower, p->vertices[p->loop_vertices[i]].z);
        upper = dgfemi_max(upper, p->vertices[p->loop_vertices[i]].z);
    }
    if (upper < point.z) return 0;
    for (l = p->face_loops[face]; l < p->face_loops[face + 1]; l++) {
        int count;
        const int *loop = dgfemi_polyhedron_loop(p, l, &count);
        for (i = 0; i < count; i++) {
            const dgfem_vec3 va = p->vertices[loop[i]], vb = p->vertices[loop[i + 1 < count ? i + 1 : 0]];
            const double a[2] = {(double)va.x, (double)va.y}, b[2] = {(double)vb.x, (double)vb.y};
            winding += dgfemi_edge_winding(a, b, q);
        }
    }
    if (winding == 0 || lower > point.z) return winding;
    normal = dgfemi_polyhedron_vector_area(p, face);
    if (normal.z < 0) normal = dgfemi_scale(-1, normal);
    return dgfemi_dot(normal, dgfemi_sub(p->vertices[p->loop_vertices[first]], point)) > 0 ? winding : 0;
}

DGFEM_API int dgfem_polyhedron_contains(const dgfem_polyhedron *polyhedron, dgfem_vec3 point) {
    int winding = 0, f;
    if (!polyhedron || !dgfemi_is_finite3(point)) return 0;
    for (f = 0; f < polyhedron->face_count; f++) winding += dgfemi_polyhedron_hits_above(polyhedron, f, point);
    return winding > 0;
}

/* ---- edges ---- */

/* All directed edges, in buckets by their lower vertex: bucket v holds start[v] <= i < start[v + 1]. */
typedef struct dgfemi_edge_table {
    int *start;          /* [vertex_count + 1] */
    int *upper;          /* the other vertex */
    int *face;           /* ~face where the face runs along the edge from the upper to the lower vertex */
    int *balance, *last; /* [vertex_count] room for users, zero */
} dgfemi_edge_table;

static int dgfemi_edge_table_allocate(const dgfem_polyhedron *p, dgfemi_arena *arena, dgfemi_edge_table *table) {
    const size_t vertices = (size_t)p->vertex_count + 1;
    const size_t corners = (size_t)dgfemi_polyhedron_first_corner(p, p->face_count);
    table->start = (int *)dgfemi_arena_allocate_zero(arena, vertices, sizeof(int));
    table->upper = (int *)dgfemi_arena_allocate(arena, corners, sizeof(int));
    table->face = (int *)dgfemi_arena_allocate(arena, corners, sizeof(int));
    table->balance = (int *)dgfemi_arena_allocate_zero(arena, vertices, sizeof(int));
    table->last = (int *)dgfemi_arena_allocate_zero(arena, vertices, sizeof(int));
    return table->start && table->upper && table->face && table->balance && table->last;
}

/* Pass 0 counts the edges of each bucket, pass 1 fills the buckets from their ends. */
static void dgfemi_edge_table_pass(const dgfem_polyhedron *p, dgfemi_edge_table *table, int pass) {
    int f, l, i, count;
    for (f = 0; f < p->face_count; f++)
        for (l = p->face_loops[f]; l < p->face_loops[f + 1]; l++) {
            const int *loop = dgfemi_polyhedron_loop(p, l, &count);
            for (i = 0; i < count; i++) {
                const int a = loop[i], b = loop[i + 1 < count ? i + 1 : 0], lower = a < b ? a : b;
                if (pass == 0) {
                    table->start[lower]++;
                } else {
                    const int slot = --table->start[lower];
                    table->upper[slot] = a < b ? b : a;
                    table->face[slot] = a < b ? f : ~f;
                }
            }
        }
}

static int dgfemi_edge_table_make(const dgfem_polyhedron *p, dgfemi_arena *arena, dgfemi_edge_table *table) {
    int v;
    if (!dgfemi_edge_table_allocate(p, arena, table)) return 0;
    dgfemi_edge_table_pass(p, table, 0);
    for (v = 1; v <= p->vertex_count; v++) table->start[v] += table->start[v - 1];
    dgfemi_edge_table_pass(p, table, 1);
    return 1;
}

/* ---- check ---- */

static dgfem_status dgfemi_check_closed(const dgfem_polyhedron *p, dgfemi_arena *arena) {
    dgfemi_edge_table table;
    int v, i;
    if (!dgfemi_edge_table_make(p, arena, &table)) return dgfemi_fail_memory(&p->hooks);
    for (v = 0; v < p->vertex_count; v++) {
        for (i = table.start[v]; i < table.start[v + 1]; i++)
            table.balance[table.upper[i]] += table.face[i] >= 0 ? 1 : -1;
        for (i = table.start[v]; i < table.start[v + 1]; i++) {
            const int upper = table.upper[i], surplus = table.balance[upper], face = table.face[i];
            if (surplus != 0 && (surplus > 0) == (face >= 0))
                return dgfemi_fail(&p->hooks, DGFEM_ERROR_OPEN,
                                   "edge from vertex %d to vertex %d of face %d lacks its opposite",
                                   surplus > 0 ? v : upper, surplus > 0 ? upper : v, face >= 0 ? face : ~face);
        }
        for (i = table.start[v]; i < table.start[v + 1]; i++) table.balance[table.upper[i]] = 0;
    }
    return DGFEM_OK;
}

/* Largest distance of a face's vertices from the plane through their mean. */
static dgfem_real dgfemi_polyhedron_unevenness(const dgfem_polyhedron *p, int face, dgfem_vec3 unit_normal) {
    const int first = dgfemi_polyhedron_first_corner(p, face), end = dgfemi_polyhedron_first_corner(p, face + 1);
    const dgfem_vec3 origin = p->vertices[p->loop_vertices[first]];
    dgfem_real sum = 0, lower = 0, upper = 0, mean;
    int i;
    for (i = first; i < end; i++) {
        const dgfem_real distance = dgfemi_dot(unit_normal, dgfemi_sub(p->vertices[p->loop_vertices[i]], origin));
        sum += distance, lower = dgfemi_min(lower, distance), upper = dgfemi_max(upper, distance);
    }
    mean = sum / (dgfem_real)(end - first);
    return dgfemi_max(upper - mean, mean - lower);
}

static int dgfemi_polyhedron_planar(const dgfem_polyhedron *p, int face, dgfem_vec3 normal, dgfemi_arena *arena,
                                    dgfemi_planar *planar) {
    const int first = p->face_loops[face], count = p->face_loops[face + 1] - first;
    return dgfemi_planar_make(planar, arena, p->vertices, p->loop_vertices, p->loop_start + first, count, normal);
}

static dgfem_status dgfemi_check_simple(const dgfem_polyhedron *p, int face, dgfem_vec3 normal) {
    dgfemi_arena arena = dgfemi_arena_make(&p->hooks);
    dgfemi_planar planar;
    dgfem_status status = DGFEM_OK;
    int e, f;
    if (!dgfemi_polyhedron_planar(p, face, normal, &arena, &planar)) {
        status = dgfemi_fail_memory(&p->hooks);
    } else if (dgfemi_planar_find_clash(&planar, &e, &f)) {
        status = dgfemi_fail(&p->hooks, DGFEM_ERROR_NOT_SIMPLE, "face %d: edge %d-%d meets edge %d-%d", face,
                             planar.vertex[e], planar.vertex[planar.next[e]], planar.vertex[f],
                             planar.vertex[planar.next[f]]);
    } else {
        e = dgfemi_planar_find_misplaced(&planar);
        if (e != DGFEM_NONE)
            status = dgfemi_fail(&p->hooks, DGFEM_ERROR_NOT_SIMPLE,
                                 "face %d: its loop %d is neither a hole nor outside", face, e);
    }
    dgfemi_arena_free(&arena);
    return status;
}

static dgfem_status dgfemi_check_face(const dgfem_polyhedron *p, int face, dgfem_real tolerance, dgfem_real size) {
    const dgfem_vec3 area = dgfemi_polyhedron_vector_area(p, face);
    const dgfem_vec3 normal = dgfemi_normalized(area);
    dgfem_real distance;
    if (!(dgfemi_dot(normal, normal) > 0))
        return dgfemi_fail(&p->hooks, DGFEM_ERROR_DEGENERATE, "face %d has no area", face);
    distance = dgfemi_polyhedron_unevenness(p, face, normal);
    if (!(distance <= tolerance * size))
        return dgfemi_fail(&p->hooks, DGFEM_ERROR_NOT_PLANAR, "face %d: a vertex lies %g off its plane", face,
                           (double)distance);
    return dgfemi_check_simple(p, face, area);
}

/* Thinner than the round-off of its coordinates counts as no volume at all. */
static dgfem_status dgfemi_check_volume(const dgfem_polyhedron *p, dgfem_real size) {
    const dgfem_measure measure = dgfem_polyhedron_measure(p);
    const dgfem_real noise = DGFEM_EPSILON * size * measure.area;
    if (measure.volume < -noise)
        return dgfemi_fail(&p->hooks, DGFEM_ERROR_INSIDE_OUT, "polyhedron has the volume %g", (double)measure.volume);
    if (!(measure.volume > noise))
        return dgfemi_fail(&p->hooks, DGFEM_ERROR_DEGENERATE, "polyhedron has the volume %g", (double)measure.volume);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_polyhedron_check(const dgfem_polyhedron *polyhedron, dgfem_real tolerance) {
    dgfemi_arena arena;
    dgfem_vec3 lower, upper;
    dgfem_status status;
    int f;
    if (!polyhedron) return DGFEM_ERROR_ARGUMENT;
    if (!(tolerance >= 0) || !dgfemi_is_finite(tolerance))
        return dgfemi_fail(&polyhedron->hooks, DGFEM_ERROR_ARGUMENT, "tolerance %g", (double)tolerance);
    arena = dgfemi_arena_make(&polyhedron->hooks);
    status = dgfemi_check_closed(polyhedron, &arena);
    dgfemi_arena_free(&arena);
    dgfemi_polyhedron_box(polyhedron, &lower, &upper);
    for (f = 0; !status && f < polyhedron->face_count; f++)
        status = dgfemi_check_face(polyhedron, f, tolerance, dgfemi_distance(lower, upper));
    return status ? status : dgfemi_check_volume(polyhedron, dgfemi_distance(lower, upper));
}

/* ---- triangles ---- */

DGFEM_API dgfem_status dgfem_polyhedron_triangulate_face(const dgfem_polyhedron *polyhedron, int face, int *triangles,
                                                         int capacity, int *count) {
    dgfemi_arena arena;
    dgfemi_planar planar;
    dgfemi_triangles out;
    dgfem_status status;
    int *group;
    if (!polyhedron) return DGFEM_ERROR_ARGUMENT;
    status = dgfemi_check_face_index(polyhedron, face);
    if (status) return status;
    if (!count || capacity < 0 || (capacity > 0 && !triangles))
        return dgfemi_fail(&polyhedron->hooks, DGFEM_ERROR_ARGUMENT, "triangles: no room for %d of them or their count",
                           capacity);
    arena = dgfemi_arena_make(&polyhedron->hooks);
    group = (int *)dgfemi_arena_allocate(
        &arena, (size_t)(polyhedron->face_loops[face + 1] - polyhedron->face_loops[face]), sizeof(int));
    if (!group ||
        !dgfemi_polyhedron_planar(polyhedron, face, dgfemi_polyhedron_vector_area(polyhedron, face), &arena, &planar)) {
        dgfemi_arena_free(&arena);
        return dgfemi_fail_memory(&polyhedron->hooks);
    }
    out.data = triangles, out.capacity = capacity, out.count = 0;
    if (capacity > 0) dgfemi_planar_triangulate(&planar, group, &out);
    *count = dgfemi_planar_triangle_count(&planar);
    dgfemi_arena_free(&arena);
    return DGFEM_OK;
}

/* ---- components ---- */

typedef struct dgfemi_components {
    int *of_face;       /* [face_count] component of each face, numbered in the order of their first faces */
    int *host;          /* the component that a void belongs to; its own number for others */
    dgfem_real *volume; /* signed */
    int *seed;          /* a vertex of the first face */
    int *winding;       /* room */
    int count;
} dgfemi_components;

static int dgfemi_root(int *parent, int i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

/* Joins faces that share an edge; the smaller number becomes the root. */
static void dgfemi_join_faces(const dgfem_polyhedron *p, const dgfemi_edge_table *table, int *parent) {
    int v, i;
    for (v = 0; v < p->vertex_count; v++)
        for (i = table->start[v]; i < table->start[v + 1]; i++) {
            const int upper = table->upper[i], face = table->face[i] >= 0 ? table->face[i] : ~table->face[i];
            if (table->last[upper] == v + 1) {
                const int a = dgfemi_root(parent, face), b = dgfemi_root(parent, table->balance[upper]);
                parent[a < b ? b : a] = a < b ? a : b;
            }
            table->last[upper] = v + 1;
            table->balance[upper] = face;
        }
}

/* Numbers the components and sums their volumes, each about a vertex of its own. */
static void dgfemi_components_measure(const dgfem_polyhedron *p, const int *parent, dgfemi_components *c) {
    int f, l, i, count;
    for (f = 0; f < p->face_count; f++) {
        if (parent[f] == f) {
            c->volume[c->count] = 0;
            c->seed[c->count] = p->loop_vertices[dgfemi_polyhedron_first_corner(p, f)];
            c->host[c->count] = c->count;
            c->of_face[f] = c->count++;
        } else {
            c->of_face[f] = c->of_face[parent[f]]; /* parents come first */
        }
        for (l = p->face_loops[f]; l < p->face_loops[f + 1]; l++) {
            const int *loop = dgfemi_polyhedron_loop(p, l, &count);
            const dgfem_vec3 o = p->vertices[c->seed[c->of_face[f]]], a = dgfemi_sub(p->vertices[loop[0]], o);
            for (i = 2; i < count; i++)
                c->volume[c->of_face[f]] += dgfemi_triple_product(a, dgfemi_sub(p->vertices[loop[i - 1]], o),
                                                                  dgfemi_sub(p->vertices[loop[i]], o)) /
                                            6;
        }
    }
}

/* A void goes to the smallest component that contains the middle of its first edge. */
static void dgfemi_components_attach_void(const dgfem_polyhedron *p, dgfemi_components *c, int hollow) {
    dgfem_vec3 point;
    int f = 0, k;
    while (c->of_face[f] != hollow) f++;
    k = dgfemi_polyhedron_first_corner(p, f);
    point =
        dgfemi_scale(DGFEM_R(0.5), dgfemi_add(p->vertices[p->loop_vertices[k]], p->vertices[p->loop_vertices[k + 1]]));
    memset(c->winding, 0, (size_t)c->count * sizeof(int));
    for (f = 0; f < p->face_count; f++) c->winding[c->of_face[f]] += dgfemi_polyhedron_hits_above(p, f, point);
    for (k = 0; k < c->count; k++) {
        const int host = c->host[hollow];
        if (c->volume[k] > 0 && c->winding[k] > 0 && (host == hollow || c->volume[k] < c->volume[host]))
            c->host[hollow] = k;
    }
}

/* Replaces the components of faces by their hosts and closes the gaps in the numbers. */
static void dgfemi_components_renumber(const dgfem_polyhedron *p, dgfemi_components *c) {
    int f, k, next = 0;
    for (f = 0; f < p->face_count; f++) c->of_face[f] = c->host[c->of_face[f]];
    for (k = 0; k < c->count; k++) c->seed[k] = DGFEM_NONE;
    for (f = 0; f < p->face_count; f++) {
        if (c->seed[c->of_face[f]] == DGFEM_NONE) c->seed[c->of_face[f]] = next++;
        c->of_face[f] = c->seed[c->of_face[f]];
    }
    c->count = next;
}

/* 0 when out of memory. */
static int dgfemi_components_find(const dgfem_polyhedron *p, dgfemi_arena *arena, dgfemi_components *c) {
    const size_t faces = (size_t)p->face_count;
    int *parent = (int *)dgfemi_arena_allocate(arena, faces, sizeof(int));
    dgfemi_edge_table table;
    int f, k;
    c->of_face = (int *)dgfemi_arena_allocate(arena, faces, sizeof(int));
    c->host = (int *)dgfemi_arena_allocate(arena, faces, sizeof(int));
    c->seed = (int *)dgfemi_arena_allocate(arena, faces, sizeof(int));
    c->winding = (int *)dgfemi_arena_allocate(arena, faces, sizeof(int));
    c->volume = (dgfem_real *)dgfemi_arena_allocate(arena, faces, sizeof(dgfem_real));
    c->count = 0;
    if (!parent || !c->of_face || !c->host || !c->seed || !c->winding || !c->volume) return 0;
    if (!dgfemi_edge_table_make(p, arena, &table)) return 0;
    for (f = 0; f < p->face_count; f++) parent[f] = f;
    dgfemi_join_faces(p, &table, parent);
    dgfemi_components_measure(p, parent, c);
    for (k = 0; k < c->count; k++)
        if (c->volume[k] < 0) dgfemi_components_attach_void(p, c, k);
    dgfemi_components_renumber(p, c);
    return 1;
}

/* The faces of component k with the vertices that they use; NULL when out of memory. */
static dgfem_polyhedron *dgfemi_polyhedron_extract(const dgfem_polyhedron *p, const int *component, int k,
                                                   int *new_vertex) {
    dgfem_polyhedron *part;
    int faces = 0, loops = 0, corners = 0, vertices = 0, f, l, i;
    for (i = 0; i < p->vertex_count; i++) new_vertex[i] = DGFEM_NONE;
    for (f = 0; f < p->face_count; f++) {
        if (component[f] != k) continue;
        faces++, loops += p->face_loops[f + 1] - p->face_loops[f];
        for (i = dgfemi_polyhedron_first_corner(p, f); i < dgfemi_polyhedron_first_corner(p, f + 1); i++, corners++)
            new_vertex[p->loop_vertices[i]] = 0;
    }
    for (i = 0; i < p->vertex_count; i++)
        if (new_vertex[i] != DGFEM_NONE) new_vertex[i] = vertices++;
    part = dgfemi_polyhedron_allocate(&p->hooks, vertices, faces, loops, corners);
    if (!part) return NULL;
    for (i = 0; i < p->vertex_count; i++)
        if (new_vertex[i] != DGFEM_NONE) part->vertices[new_vertex[i]] = p->vertices[i];
    faces = loops = corners = 0;
    for (f = 0; f < p->face_count; f++) {
        if (component[f] != k) continue;
        part->face_loops[faces++] = loops;
        for (l = p->face_loops[f]; l < p->face_loops[f + 1]; l++) {
            part->loop_start[loops++] = corners;
            for (i = p->loop_start[l]; i < p->loop_start[l + 1]; i++)
                part->loop_vertices[corners++] = new_vertex[p->loop_vertices[i]];
        }
    }
    part->face_loops[faces] = loops;
    part->loop_start[loops] = corners;
    return part;
}

DGFEM_API dgfem_status dgfem_polyhedron_component_count(const dgfem_polyhedron *polyhedron, int *count) {
    dgfemi_arena arena;
    dgfemi_components components;
    int ok;
    if (!polyhedron) return DGFEM_ERROR_ARGUMENT;
    if (!count) return dgfemi_fail(&polyhedron->hooks, DGFEM_ERROR_ARGUMENT, "components: nowhere to put their number");
    arena = dgfemi_arena_make(&polyhedron->hooks);
    ok = dgfemi_components_find(polyhedron, &arena, &components);
    if (ok) *count = components.count;
    dgfemi_arena_free(&arena);
    return ok ? DGFEM_OK : dgfemi_fail_memory(&polyhedron->hooks);
}

DGFEM_API dgfem_status dgfem_polyhedron_component(const dgfem_polyhedron *polyhedron, int k, dgfem_polyhedron **out) {
    dgfemi_arena arena;
    dgfemi_components components;
    dgfem_status status = DGFEM_OK;
    int *new_vertex;
    if (out) *out = NULL;
    if (!polyhedron) return DGFEM_ERROR_ARGUMENT;
    if (!out) return dgfemi_fail(&polyhedron->hooks, DGFEM_ERROR_ARGUMENT, "component: nowhere to put it");
    arena = dgfemi_arena_make(&polyhedron->hooks);
    new_vertex = (int *)dgfemi_arena_allocate(&arena, (size_t)polyhedron->vertex_count, sizeof(int));
    if (!new_vertex || !dgfemi_components_find(polyhedron, &arena, &components)) {
        status = dgfemi_fail_memory(&polyhedron->hooks);
    } else if (k < 0 || k >= components.count) {
        status = dgfemi_fail(&polyhedron->hooks, DGFEM_ERROR_INDEX, "component %d of %d", k, components.count);
    } else {
        *out = dgfemi_polyhedron_extract(polyhedron, components.of_face, k, new_vertex);
        if (!*out) status = dgfemi_fail_memory(&polyhedron->hooks);
    }
    dgfemi_arena_free(&arena);
    return status;
}
