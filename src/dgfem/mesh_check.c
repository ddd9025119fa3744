#pragma once
#include "mesh.c"
/* dgfem_mesh_check: every invariant of the cell complex.

   The phases run from raw indices to geometry, so that each may rely on those before. Vector areas of an element need
   no test of their own: its directed edges cancel, and each face's stored area vector is that of its loops. */

typedef struct dgfemi_mesh_checker {
    const dgfem_mesh *mesh;
    unsigned char *loop_used, *loop_vertex_used, *element_face_used; /* ranges must not overlap */
    int *face_mark;                                                  /* the last element that listed the face */
    int *face_sides;                                                 /* how many elements list it */
    dgfemi_edges edges;
} dgfemi_mesh_checker;

#define DGFEM_BROKEN(...) dgfemi_fail(&mesh->hooks, DGFEM_ERROR_INVARIANT, __VA_ARGS__)

static dgfem_status dgfemi_check_pool(const dgfem_mesh *mesh, const char *name, const void *data, int count,
                                      int capacity) {
    if (count < 0 || count > capacity || (count > 0 && !data))
        return DGFEM_BROKEN("%s: count %d, capacity %d%s", name, count, capacity, data ? "" : ", no data");
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_pools(const dgfem_mesh *mesh) {
    dgfem_status status =
        dgfemi_check_pool(mesh, "vertices", mesh->vertices, mesh->vertex_count, mesh->vertex_capacity);
    if (!status) status = dgfemi_check_pool(mesh, "faces", mesh->faces, mesh->face_count, mesh->face_capacity);
    if (!status)
        status = dgfemi_check_pool(mesh, "elements", mesh->elements, mesh->element_count, mesh->element_capacity);
    if (!status) status = dgfemi_check_pool(mesh, "loops", mesh->loops, mesh->loop_count, mesh->loop_capacity);
    if (!status)
        status = dgfemi_check_pool(mesh, "loop_vertices", mesh->loop_vertices, mesh->loop_vertex_count,
                                   mesh->loop_vertex_capacity);
    if (!status)
        status = dgfemi_check_pool(mesh, "element_faces", mesh->element_faces, mesh->element_face_count,
                                   mesh->element_face_capacity);
    if (!status && mesh->element_count == 0) status = DGFEM_BROKEN("the mesh has no elements");
    return status;
}

/* 1 when the range lies in the pool and was free; it is taken. */
static int dgfemi_take_range(unsigned char *used, int pool_count, int start, int count) {
    int i;
    if (start < 0 || count < 1 || start > pool_count || count > pool_count - start) return 0;
    for (i = start; i < start + count; i++) {
        if (used[i]) return 0;
        used[i] = 1;
    }
    return 1;
}

static dgfem_status dgfemi_check_loop(dgfemi_mesh_checker *checker, int face, int l) {
    const dgfem_mesh *mesh = checker->mesh;
    dgfem_loop loop = mesh->loops[l];
    const int *v;
    int i;
    if (loop.count < 3) return DGFEM_BROKEN("face %d: loop %d has %d vertices", face, l, loop.count);
    if (!dgfemi_take_range(checker->loop_vertex_used, mesh->loop_vertex_count, loop.start, loop.count))
        return DGFEM_BROKEN("face %d: loop %d, vertices %d + %d: out of range or shared with another loop", face, l,
                            loop.start, loop.count);
    v = mesh->loop_vertices + loop.start;
    for (i = 0; i < loop.count; i++)
        if (v[i] < 0 || v[i] >= mesh->vertex_count)
            return DGFEM_BROKEN("face %d: loop %d refers to vertex %d of %d", face, l, v[i], mesh->vertex_count);
    for (i = 0; i < loop.count; i++) {
        int next = v[(i + 1) % loop.count];
        if (v[i] == next) return DGFEM_BROKEN("face %d: loop %d has vertex %d twice in a row", face, l, next);
        if (v[i] == v[(i + 2) % loop.count])
            return DGFEM_BROKEN("face %d: loop %d runs to vertex %d and straight back", face, l, next);
    }
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_face_links(dgfemi_mesh_checker *checker, int f) {
    const dgfem_mesh *mesh = checker->mesh;
    const dgfem_face *face = &mesh->faces[f];
    dgfem_status status = DGFEM_OK;
    int l;
    if (face->element[0] < 0 || face->element[0] >= mesh->element_count || face->element[1] < DGFEM_NONE ||
        face->element[1] >= mesh->element_count)
        return DGFEM_BROKEN("face %d: elements %d and %d of %d", f, face->element[0], face->element[1],
                            mesh->element_count);
    if (face->element[0] == face->element[1])
        return DGFEM_BROKEN("face %d: element %d on both sides", f, face->element[0]);
    if (face->cut != 0 && face->cut != 1) return DGFEM_BROKEN("face %d: cut is %d", f, face->cut);
    if (!(dgfemi_abs(dgfemi_dot(face->normal, face->normal) - 1) <= 64 * DGFEM_EPSILON))
        return DGFEM_BROKEN("face %d: normal %g %g %g is not a unit vector", f, (double)face->normal.x,
                            (double)face->normal.y, (double)face->normal.z);
    if (!dgfemi_take_range(checker->loop_used, mesh->loop_count, face->loop_start, face->loop_count))
        return DGFEM_BROKEN("face %d: loops %d + %d: out of range or shared with another face", f, face->loop_start,
                            face->loop_count);
    for (l = face->loop_start; !status && l < face->loop_start + face->loop_count; l++)
        status = dgfemi_check_loop(checker, f, l);
    return status;
}

static dgfem_status dgfemi_check_element_links(dgfemi_mesh_checker *checker, int e) {
    const dgfem_mesh *mesh = checker->mesh;
    const dgfem_element *element = &mesh->elements[e];
    int k;
    if (!dgfemi_take_range(checker->element_face_used, mesh->element_face_count, element->face_start,
                           element->face_count))
        return DGFEM_BROKEN("element %d: faces %d + %d: out of range or shared with another element", e,
                            element->face_start, element->face_count);
    if (!(element->radius > 0)) /* the tolerance of its faces */
        return DGFEM_BROKEN("element %d: radius %g", e, (double)element->radius);
    for (k = element->face_start; k < element->face_start + element->face_count; k++) {
        int f = mesh->element_faces[k];
        if (f < 0 || f >= mesh->face_count)
            return DGFEM_BROKEN("element %d refers to face %d of %d", e, f, mesh->face_count);
        if (checker->face_mark[f] == e) return DGFEM_BROKEN("element %d lists face %d twice", e, f);
        if (mesh->faces[f].element[0] != e && mesh->faces[f].element[1] != e)
            return DGFEM_BROKEN("element %d lists face %d, which lies between %d and %d", e, f,
                                mesh->faces[f].element[0], mesh->faces[f].element[1]);
        checker->face_mark[f] = e;
        checker->face_sides[f]++;
    }
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_links(dgfemi_mesh_checker *checker) {
    const dgfem_mesh *mesh = checker->mesh;
    dgfem_status status = DGFEM_OK;
    int v, f, e;
    for (v = 0; v < mesh->vertex_count; v++)
        if (!dgfemi_is_finite3(mesh->vertices[v])) return DGFEM_BROKEN("vertex %d is not finite", v);
    for (f = 0; !status && f < mesh->face_count; f++) {
        checker->face_mark[f] = DGFEM_NONE;
        status = dgfemi_check_face_links(checker, f);
    }
    for (e = 0; !status && e < mesh->element_count; e++) status = dgfemi_check_element_links(checker, e);
    for (f = 0; !status && f < mesh->face_count; f++)
        if (checker->face_sides[f] != (mesh->faces[f].element[1] == DGFEM_NONE ? 1 : 2))
            status = DGFEM_BROKEN("face %d between elements %d and %d is listed by %d of them", f,
                                  mesh->faces[f].element[0], mesh->faces[f].element[1], checker->face_sides[f]);
    return status;
}

/* What round-off may do to a position in this box. Vertices made in cuts are rounded relative to their distance from
   the origin, not to the size of the element. */
static dgfem_real dgfemi_position_noise(dgfem_vec3 lower, dgfem_vec3 upper) {
    dgfem_real x = dgfemi_max(dgfemi_abs(lower.x), dgfemi_abs(upper.x));
    dgfem_real y = dgfemi_max(dgfemi_abs(lower.y), dgfemi_abs(upper.y));
    dgfem_real z = dgfemi_max(dgfemi_abs(lower.z), dgfemi_abs(upper.z));
    return 64 * DGFEM_EPSILON * dgfemi_max(x, dgfemi_max(y, z));
}

/* A face is planar when its vertices keep within this many element radii of its plane. Wide, because a plane split may
   snap vertices onto its plane without moving them. */
#define DGFEM_PLANARITY DGFEM_R(0.05)

static dgfem_real dgfemi_mesh_perimeter(const dgfem_mesh *mesh, int face) {
    const dgfem_face *f = &mesh->faces[face];
    dgfem_real sum = 0;
    int l, i;
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        dgfem_vec3 last = mesh->vertices[loop[mesh->loops[l].count - 1]];
        for (i = 0; i < mesh->loops[l].count; i++) {
            sum += dgfemi_distance(last, mesh->vertices[loop[i]]);
            last = mesh->vertices[loop[i]];
        }
    }
    return sum;
}

static dgfem_status dgfemi_check_face_shape(const dgfem_mesh *mesh, int f) {
    const dgfem_face *face = &mesh->faces[f];
    dgfem_real radius = mesh->elements[face->element[0]].radius, perimeter = dgfemi_mesh_perimeter(mesh, f);
    dgfem_real area, noise, size, off_plane;
    dgfem_vec3 lower = dgfemi_mesh_first_vertex(mesh, f), upper = lower, centre, error;
    if (face->element[1] != DGFEM_NONE) radius = dgfemi_max(radius, mesh->elements[face->element[1]].radius);
    dgfemi_mesh_face_box(mesh, f, &lower, &upper);
    noise = dgfemi_position_noise(lower, upper);
    size = dgfemi_distance(lower, upper);

    dgfemi_mesh_face_measures(mesh, f, &centre, &area);
    if (!(dgfemi_abs(area - face->area) <= noise * perimeter) || !(face->area >= 0))
        return DGFEM_BROKEN("face %d: area is %g, stored %g", f, (double)area, (double)face->area);
    if (!(dgfemi_distance(centre, face->centre) * area <= noise * perimeter * size) ||
        !(dgfemi_distance(centre, face->centre) <= size + noise))
        return DGFEM_BROKEN("face %d: centre is %g %g %g, stored %g %g %g", f, (double)centre.x, (double)centre.y,
                            (double)centre.z, (double)face->centre.x, (double)face->centre.y, (double)face->centre.z);

    off_plane = dgfemi_mesh_face_off_plane(mesh, f, face->normal, dgfemi_dot(face->normal, face->centre));
    if (!(off_plane <= DGFEM_PLANARITY * radius + noise))
        return DGFEM_BROKEN("face %d: a vertex is %g off its plane", f, (double)off_plane);
    error = dgfemi_add_scaled(dgfemi_mesh_vector_area(mesh, f), -face->area, face->normal);
    if (!(dgfemi_norm(error) <= (off_plane + noise) * perimeter))
        return DGFEM_BROKEN("face %d: its loops do not run counter-clockwise about its normal %g %g %g", f,
                            (double)face->normal.x, (double)face->normal.y, (double)face->normal.z);
    return DGFEM_OK;
}

/* A face at an edge: how far it is turned about the edge, and which way it runs along it. */
typedef struct dgfemi_fan_blade {
    dgfem_real angle; /* grows with the angle about a -> b, 0..4 */
    int direction;    /* +1 along a -> b, seen from outside the element */
} dgfemi_fan_blade;

/* In (0, 4], growing with the angle of (x, y). */
static dgfem_real dgfemi_pseudo_angle(dgfem_real x, dgfem_real y) {
    dgfem_real ratio = x / (dgfemi_abs(x) + dgfemi_abs(y));
    return y > 0 ? 2 - (1 + ratio) : 3 + ratio;
}

/* The blades of element e at an edge; returns their number, at most `capacity`. The inside of a face lies to the left
   of its loops. */
static int dgfemi_collect_blades(const dgfem_mesh *mesh, int e, const dgfemi_edge *edge, dgfemi_fan_blade *blades,
                                 int capacity) {
    const dgfem_element *element = &mesh->elements[e];
    dgfem_vec3 axis = dgfemi_normalized(dgfemi_sub(mesh->vertices[edge->b], mesh->vertices[edge->a]));
    dgfem_vec3 u = dgfemi_vec3(0, 0, 0), v = u;
    int k, l, i, count = 0;
    for (k = element->face_start; k < element->face_start + element->face_count; k++) {
        int f = mesh->element_faces[k];
        const dgfem_face *face = &mesh->faces[f];
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
            const int *loop = mesh->loop_vertices + mesh->loops[l].start;
            for (i = 0; i < mesh->loops[l].count; i++) {
                int from = loop[i], to = loop[(i + 1) % mesh->loops[l].count], along = from == edge->a ? 1 : -1;
                dgfem_vec3 inside;
                if ((from != edge->a || to != edge->b) && (from != edge->b || to != edge->a)) continue;
                if (count == capacity) return count;
                inside = dgfemi_scale((dgfem_real)along, dgfemi_cross(face->normal, axis));
                if (count == 0) u = dgfemi_normalized(inside), v = dgfemi_cross(axis, u);
                blades[count].angle = dgfemi_pseudo_angle(dgfemi_dot(inside, u), dgfemi_dot(inside, v));
                blades[count++].direction = along * dgfemi_mesh_sign(mesh, e, f);
            }
        }
    }
    return count;
}

/* An edge where an element touches itself is sound when no two faces coincide and inside and outside take turns about
   it. Counter-clockwise, the inside lies behind a face that runs backward (b) and before one that runs forward (f):

                     outside
                   f \     / b
             inside   > * <   inside
                   b /     \ f
                     outside                                                                                    */
static int dgfemi_edge_alternates(const dgfem_mesh *mesh, int e, const dgfemi_edge *edge) {
    enum { MAX_BLADES = 16 };
    dgfemi_fan_blade blades[MAX_BLADES + 1];
    int count = dgfemi_collect_blades(mesh, e, edge, blades, MAX_BLADES + 1), i, j;
    if (count > MAX_BLADES) return 1; /* too many to tell */
    for (i = 1; i < count; i++) {
        dgfemi_fan_blade blade = blades[i];
        for (j = i; j > 0 && blade.angle < blades[j - 1].angle; j--) blades[j] = blades[j - 1];
        blades[j] = blade;
    }
    for (i = 0; i < count; i++) {
        int next = (i + 1) % count;
        dgfem_real gap = blades[next].angle - blades[i].angle + (next == 0 ? 4 : 0);
        if (!(gap > 64 * DGFEM_EPSILON) || blades[i].direction == blades[next].direction) return 0;
    }
    return 1;
}

static dgfem_status dgfemi_check_element_closed(dgfemi_mesh_checker *checker, int e) {
    const dgfem_mesh *mesh = checker->mesh;
    const dgfem_element *element = &mesh->elements[e];
    int k, i, corners = 0;
    for (k = element->face_start; k < element->face_start + element->face_count; k++)
        corners += dgfemi_mesh_face_corners(mesh, mesh->element_faces[k]);
    if (!dgfemi_edges_reset(&mesh->hooks, &checker->edges, corners)) return dgfemi_fail_memory(&mesh->hooks);
    for (k = element->face_start; k < element->face_start + element->face_count; k++) {
        int f = mesh->element_faces[k];
        dgfemi_edges_add_face(mesh, &checker->edges, f, dgfemi_mesh_sign(mesh, e, f));
    }
    for (i = 0; i < checker->edges.count; i++) {
        const dgfemi_edge *edge = &checker->edges.data[i];
        if (edge->forward != edge->backward || (edge->forward > 1 && !dgfemi_edge_alternates(mesh, e, edge)))
            return DGFEM_BROKEN("element %d: edge from vertex %d to %d occurs %d times, its opposite %d times", e,
                                edge->a, edge->b, edge->forward, edge->backward);
    }
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_element_shape(const dgfem_mesh *mesh, int e) {
    const dgfem_element *element = &mesh->elements[e];
    dgfem_vec3 lower, upper, centre;
    dgfem_real volume, noise, size, radius, area = 0;
    int k;
    dgfemi_mesh_element_box(mesh, e, &lower, &upper);
    noise = dgfemi_position_noise(lower, upper);
    size = dgfemi_distance(lower, upper);
    for (k = element->face_start; k < element->face_start + element->face_count; k++)
        area += mesh->faces[mesh->element_faces[k]].area;

    dgfemi_mesh_element_measures(mesh, e, lower, upper, &centre, &volume);
    if (!(element->volume > 0)) return DGFEM_BROKEN("element %d: volume %g", e, (double)element->volume);
    if (!(dgfemi_abs(volume - element->volume) <= noise * area))
        return DGFEM_BROKEN("element %d: volume is %g, stored %g", e, (double)volume, (double)element->volume);
    if (!(dgfemi_distance(centre, element->centre) * element->volume <= noise * area * size) ||
        !(dgfemi_distance(centre, element->centre) <= size + noise))
        return DGFEM_BROKEN("element %d: centre is %g %g %g, stored %g %g %g", e, (double)centre.x, (double)centre.y,
                            (double)centre.z, (double)element->centre.x, (double)element->centre.y,
                            (double)element->centre.z);
    radius = dgfemi_mesh_element_reach(mesh, e, element->centre);
    if (!(dgfemi_abs(radius - element->radius) <= noise))
        return DGFEM_BROKEN("element %d: radius is %g, stored %g", e, (double)radius, (double)element->radius);
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_phases(dgfemi_mesh_checker *checker) {
    const dgfem_mesh *mesh = checker->mesh;
    dgfem_status status = dgfemi_check_links(checker);
    int f, e;
    for (e = 0; !status && e < mesh->element_count; e++) status = dgfemi_check_element_closed(checker, e);
    for (f = 0; !status && f < mesh->face_count; f++) status = dgfemi_check_face_shape(mesh, f);
    for (e = 0; !status && e < mesh->element_count; e++) status = dgfemi_check_element_shape(mesh, e);
    return status;
}

#undef DGFEM_BROKEN

DGFEM_API dgfem_status dgfem_mesh_check(const dgfem_mesh *mesh) {
    dgfemi_mesh_checker checker;
    dgfemi_arena arena;
    dgfem_status status;
    if (!mesh) return DGFEM_ERROR_ARGUMENT;
    status = dgfemi_check_pools(mesh);
    if (status) return status;
    memset(&checker, 0, sizeof checker);
    arena = dgfemi_arena_make(&mesh->hooks);
    checker.mesh = mesh;
    checker.loop_used = (unsigned char *)dgfemi_arena_allocate_zero(&arena, (size_t)mesh->loop_count, 1);
    checker.loop_vertex_used = (unsigned char *)dgfemi_arena_allocate_zero(&arena, (size_t)mesh->loop_vertex_count, 1);
    checker.element_face_used =
        (unsigned char *)dgfemi_arena_allocate_zero(&arena, (size_t)mesh->element_face_count, 1);
    checker.face_mark = (int *)dgfemi_arena_allocate(&arena, (size_t)mesh->face_count, sizeof(int));
    checker.face_sides = (int *)dgfemi_arena_allocate_zero(&arena, (size_t)mesh->face_count, sizeof(int));
    if (checker.loop_used && checker.loop_vertex_used && checker.element_face_used && checker.face_mark &&
        checker.face_sides)
        status = dgfemi_check_phases(&checker);
    else status = dgfemi_fail_memory(&mesh->hooks);
    dgfemi_edges_free(&mesh->hooks, &checker.edges);
    dgfemi_arena_free(&arena);
    return status;
}
