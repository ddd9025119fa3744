#pragma once
#include "triangulate.c"
/* From a cell complex to nodes, faces and elements; the check of all invariants. */

/* ---- from the cell complex ---- */

static dgfem_status dgfem_mvci_check_source(const dgfem_mesh *source, const dgfem_hooks *hooks) {
    for (int f = 0; f < source->face_count; f++) {
        const dgfem_face *face = &source->faces[f];
        if (face->loop_count != 1)
            return dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT,
                                   "face %d of element %d has %d loops: holes must be cut open", f, face->element[0],
                                   face->loop_count);
    }
    for (int i = 0; i < source->vertex_count; i++)
        if (!dgfem_mvci_is_finite3(source->vertices[i]))
            return dgfem_mvci_fail(hooks, DGFEM_ERROR_NOT_FINITE, "vertex %d", i);
    return DGFEM_OK;
}

/* The loop of a face as nodes of one of its elements; at[] gives the element's node at each vertex. */
static void dgfem_mvci_source_loop(const dgfem_mesh *source, const dgfem_face *face, const int *at, int reversed,
                                   int *out) {
    const dgfem_loop *loop = &source->loops[face->loop_start];
    for (int i = 0; i < loop->count; i++)
        out[reversed ? loop->count - 1 - i : i] = at[source->loop_vertices[loop->start + i]];
}

/* Elements and their faces, in the order of the source; of faces that are cut, the side of element[1] is appended. */
static int dgfem_mvci_mesh_read(dgfem_mvci_mesh *mesh, const dgfem_mesh *source, const dgfem_corners *corners, int *at,
                                int *loop) {
    for (int e = 0; e < source->element_count; e++) {
        const dgfem_element *element = &source->elements[e];
        if (dgfem_mvci_add_element(mesh, e) == DGFEM_NONE) return 0;
        for (int i = corners->corner_start[e]; i < corners->corner_start[e + 1]; i++)
            at[corners->vertex[corners->corners[i]]] = corners->corners[i];
        for (int k = 0; k < element->face_count; k++) {
            int f = source->element_faces[element->face_start + k], side = source->faces[f].element[0] != e;
            const dgfem_face *face = &source->faces[f];
            int count = source->loops[face->loop_start].count, index = f;
            if (!side || face->cut) dgfem_mvci_source_loop(source, face, at, side, loop);
            if (!side && !dgfem_mvci_set_loop(mesh, f, loop, count)) return 0;
            if (!side) mesh->faces[f].owner[0] = e;
            if (side && !face->cut) mesh->faces[f].owner[1] = e;
            if (side && face->cut) index = dgfem_mvci_add_face(mesh, e, DGFEM_NONE, loop, count, DGFEM_NONE, 1);
            if (!side && face->cut) mesh->faces[f].wall = 1;
            if (index == DGFEM_NONE) return 0;
            if (!dgfem_mvci_add_element_face(mesh, e, index, side && !face->cut)) return 0;
        }
    }
    return 1;
}

static int dgfem_mvci_mesh_fill(dgfem_mvci_mesh *mesh, const dgfem_mesh *source, const dgfem_corners *corners,
                                dgfem_mvci_scratch *scratch) {
    int most = 0;
    for (int i = 0; i < source->loop_count; i++)
        if (source->loops[i].count > most) most = source->loops[i].count;
    int *at = (int *)dgfem_mvci_take(scratch, (size_t)source->vertex_count, sizeof(int));
    int *loop = (int *)dgfem_mvci_take(scratch, (size_t)most, sizeof(int));
    if (!at || !loop || !dgfem_mvci_mesh_node_room(mesh, corners->count)) return 0;
    mesh->node_count = corners->count;
    for (int i = 0; i < corners->count; i++) {
        mesh->rest[i] = mesh->position[i] = source->vertices[corners->vertex[i]];
        mesh->velocity[i] = dgfem_mvci_vec3(0, 0, 0);
    }
    for (int f = 0; f < source->face_count; f++)
        if (dgfem_mvci_add_face(mesh, DGFEM_NONE, DGFEM_NONE, loop, 0, f, 0) == DGFEM_NONE) return 0;
    return dgfem_mvci_mesh_read(mesh, source, corners, at, loop);
}

/* Elements must be star-shaped about their centroid. */
static dgfem_status dgfem_mvci_check_star(const dgfem_mvci_mesh *mesh, const dgfem_hooks *hooks,
                                          dgfem_status otherwise) {
    for (int e = 0; e < mesh->element_count; e++) {
        dgfem_vec3 centre;
        int face = DGFEM_NONE;
        dgfem_real volume = dgfem_mvci_element_measure(mesh, e, &centre);
        if (!(volume > 0)) return dgfem_mvci_fail(hooks, otherwise, "element %d has the volume %g", e, (double)volume);
        if (!(dgfem_mvci_element_star(mesh, e, centre, &face) > 0))
            return dgfem_mvci_fail(hooks, otherwise,
                                   "element %d is not star-shaped: its centroid does not see face %d from inside", e,
                                   face);
    }
    return DGFEM_OK;
}

/* Logs what it refuses. The source's hooks take care of its corners. */
static dgfem_status dgfem_mvci_mesh_create(const dgfem_mesh *source, const dgfem_hooks *hooks, dgfem_mvci_mesh **out) {
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(hooks);
    dgfem_corners *corners = NULL;
    dgfem_mvci_ints bad;
    dgfem_status status = dgfem_mvci_check_source(source, hooks);
    *out = NULL;
    if (!status) status = dgfem_mesh_corners(source, &corners);
    if (status) return status;
    memset(&bad, 0, sizeof bad);
    dgfem_mvci_mesh *mesh = dgfem_mvci_mesh_new(hooks);
    if (!mesh || !dgfem_mvci_mesh_fill(mesh, source, corners, &scratch)) status = DGFEM_ERROR_MEMORY;
    if (!status) status = dgfem_mvci_mesh_settle(mesh, &bad);
    if (!status && !dgfem_mvci_mesh_compact(mesh)) status = DGFEM_ERROR_MEMORY;
    if (status == DGFEM_ERROR_MEMORY) (void)dgfem_mvci_fail_memory(hooks);
    if (status == DGFEM_ERROR_DEGENERATE)
        (void)dgfem_mvci_fail(hooks, status, "face %d has no area, or corners too close to its other sides",
                              bad.data[0]);
    if (!status) status = dgfem_mvci_check_star(mesh, hooks, DGFEM_ERROR_DEGENERATE);
    dgfem_corners_destroy(corners);
    dgfem_mvci_free(hooks, bad.data);
    dgfem_mvci_scratch_free(&scratch);
    if (status) {
        dgfem_mvci_mesh_destroy(mesh);
        return status;
    }
    dgfem_mvci_mesh_begin(mesh);
    *out = mesh;
    return DGFEM_OK;
}

/* ---- the check ---- */

static dgfem_status dgfem_mvci_check_faces(const dgfem_mvci_mesh *mesh, int *listed) {
    const dgfem_hooks *hooks = &mesh->hooks;
    const dgfem_status broken = DGFEM_ERROR_INVARIANT;
    for (int f = 0; f < mesh->face_count; f++) {
        const dgfem_mvci_face *face = &mesh->faces[f];
        if (face->owner[0] < 0 || face->owner[0] >= mesh->element_count || face->owner[1] < DGFEM_NONE ||
            face->owner[1] >= mesh->element_count || face->owner[0] == face->owner[1])
            return dgfem_mvci_fail(hooks, broken, "face %d has the elements %d and %d", f, face->owner[0],
                                   face->owner[1]);
        if (face->count < 3 || face->triangle_count != face->count - 2)
            return dgfem_mvci_fail(hooks, broken, "face %d of %d nodes has %d triangles", f, face->count,
                                   face->triangle_count);
        for (int i = 0; i < face->count; i++) {
            int node = mesh->loops.data[face->loop + i];
            if (node < 0 || node >= mesh->node_count)
                return dgfem_mvci_fail(hooks, broken, "face %d has the node %d", f, node);
        }
    }
    for (int e = 0; e < mesh->element_count; e++) {
        int count;
        const int *faces = dgfem_mvci_element_faces(mesh, e, &count);
        if (count < 4) return dgfem_mvci_fail(hooks, broken, "element %d has %d faces", e, count);
        for (int k = 0; k < count; k++) {
            if (faces[k] < 0 || faces[k] / 2 >= mesh->face_count || mesh->faces[faces[k] / 2].owner[faces[k] & 1] != e)
                return dgfem_mvci_fail(hooks, broken, "element %d is no element of its face %d", e, faces[k] / 2);
            listed[faces[k]]++;
        }
    }
    for (int f = 0; f < mesh->face_count; f++)
        if (listed[2 * f] != 1 || listed[2 * f + 1] != (mesh->faces[f].owner[1] != DGFEM_NONE))
            return dgfem_mvci_fail(hooks, broken, "face %d is listed %d and %d times by its elements", f, listed[2 * f],
                                   listed[2 * f + 1]);
    return DGFEM_OK;
}

/* No bent face, no flat triangle. */
static dgfem_status dgfem_mvci_check_shape(const dgfem_mvci_mesh *mesh, int f, dgfem_mvci_polygon *polygon) {
    const dgfem_mvci_face *face = &mesh->faces[f];
    if (!dgfem_mvci_polygon_room(&mesh->hooks, polygon, face->count)) return dgfem_mvci_fail_memory(&mesh->hooks);
    const int *loop = mesh->loops.data + face->loop;
    dgfem_vec3 normal = dgfem_mvci_unit(dgfem_mvci_loop_area(mesh->rest, loop, face->count));
    double off = dgfem_mvci_polygon_project(mesh, loop, face->count, normal, polygon);
    if (face->count > 3 && !(off < 100 * DGFEM_MVC_PLANAR))
        return dgfem_mvci_fail(&mesh->hooks, DGFEM_ERROR_INVARIANT, "face %d is bent by %g of its coordinates", f, off);
    for (int t = 0; t < face->triangle_count; t++) {
        int nodes[3];
        dgfem_mvci_triangle(mesh, f, 0, t, nodes);
        dgfem_vec3 area = dgfem_mvci_loop_area(mesh->rest, nodes, 3);
        double longest = 0, size = (double)dgfem_mvci_dot(area, normal);
        for (int i = 0; i < 3; i++) {
            double length = (double)dgfem_mvci_distance(mesh->rest[nodes[i]], mesh->rest[nodes[(i + 1) % 3]]);
            if (length > longest) longest = length;
        }
        if (!(size > DGFEM_MVC_FLAT / 2 * longest * longest))
            return dgfem_mvci_fail(&mesh->hooks, DGFEM_ERROR_INVARIANT, "triangle %d of face %d is flat", t, f);
    }
    return DGFEM_OK;
}

/* Adds a directed edge of an element; 0 where it is there already. */
static int dgfem_mvci_check_edge(dgfem_mvci_edges *edges, int a, int b) {
    dgfem_mvci_edge *edge = dgfem_mvci_edges_at(edges, a, b);
    if (edge->value != DGFEM_NONE) return 0;
    edge->value = 0;
    return 1;
}

/* Each directed edge of loops, and of triangles, once and once the other way; a surface like a sphere. */
static dgfem_status dgfem_mvci_check_element(const dgfem_mvci_mesh *mesh, int e, dgfem_mvci_edges *edges, int *mark,
                                             int *nodes) {
    const dgfem_hooks *hooks = &mesh->hooks;
    int face_count, triangles = 0;
    const int *faces = dgfem_mvci_element_faces(mesh, e, &face_count);
    for (int kind = 0; kind < 2; kind++) {
        if (!dgfem_mvci_edges_reset(hooks, edges, 3 * dgfem_mvci_element_corners(mesh, e)))
            return dgfem_mvci_fail_memory(hooks);
        for (int pass = 0; pass < 2; pass++)
            for (int k = 0; k < face_count; k++) {
                const dgfem_mvci_face *face = &mesh->faces[faces[k] / 2];
                int corners = kind ? 3 : face->count, parts = kind ? face->triangle_count : 1;
                const int *corner = kind ? mesh->triangles.data + face->triangle : mesh->loops.data + face->loop;
                for (int i = 0; i < parts * corners; i++) {
                    int a = corner[i], b = corner[i + 1 - ((i + 1) % corners ? 0 : corners)];
                    int forward = !(faces[k] & 1) == !pass; /* the second pass looks for the opposites */
                    int from = forward ? a : b, to = forward ? b : a;
                    if (pass ? dgfem_mvci_edges_find(edges, from, to) == DGFEM_NONE
                             : !dgfem_mvci_check_edge(edges, from, to))
                        return dgfem_mvci_fail(hooks, DGFEM_ERROR_INVARIANT,
                                               "element %d: the edge of nodes %d and %d in face %d %s", e, from, to,
                                               faces[k] / 2, pass ? "has no opposite" : "is there twice");
                }
                if (kind && !pass) triangles += face->triangle_count;
            }
    }
    int count = dgfem_mvci_element_nodes(mesh, e, mark, nodes);
    if (triangles != 2 * count - 4)
        return dgfem_mvci_fail(hooks, DGFEM_ERROR_INVARIANT, "element %d of %d nodes has %d triangles: not a ball", e,
                               count, triangles);
    return DGFEM_OK;
}

/* All invariants; DGFEM_ERROR_INVARIANT and a log line that names the offender. */
static dgfem_status dgfem_mvci_mesh_check(const dgfem_mvci_mesh *mesh) {
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&mesh->hooks);
    dgfem_mvci_edges edges;
    dgfem_mvci_polygon polygon;
    memset(&edges, 0, sizeof edges);
    memset(&polygon, 0, sizeof polygon);
    int *listed = (int *)dgfem_mvci_take(&scratch, 2 * (size_t)mesh->face_count, sizeof(int));
    int *mark = (int *)dgfem_mvci_take(&scratch, (size_t)mesh->node_count, sizeof(int));
    dgfem_status status = listed && mark ? DGFEM_OK : dgfem_mvci_fail_memory(&mesh->hooks);
    if (!status) status = dgfem_mvci_check_faces(mesh, listed);
    int *nodes = NULL;
    if (!status) {
        nodes = (int *)dgfem_mvci_take(&scratch, (size_t)dgfem_mvci_max_element_corners(mesh), sizeof(int));
        if (!nodes) status = dgfem_mvci_fail_memory(&mesh->hooks);
    }
    for (int i = 0; !status && i < mesh->node_count; i++) mark[i] = DGFEM_NONE;
    for (int f = 0; !status && f < mesh->face_count; f++) status = dgfem_mvci_check_shape(mesh, f, &polygon);
    for (int e = 0; !status && e < mesh->element_count; e++)
        status = dgfem_mvci_check_element(mesh, e, &edges, mark, nodes);
    for (int i = 0; !status && i < mesh->node_count; i++)
        if (mark[i] == DGFEM_NONE || !dgfem_mvci_is_finite3(mesh->rest[i]))
            status = dgfem_mvci_fail(&mesh->hooks, DGFEM_ERROR_INVARIANT, "node %d is in no element or nowhere", i);
    if (!status) status = dgfem_mvci_check_star(mesh, &mesh->hooks, DGFEM_ERROR_INVARIANT);
    dgfem_mvci_free(&mesh->hooks, edges.slots);
    dgfem_mvci_polygon_free(&mesh->hooks, &polygon);
    dgfem_mvci_scratch_free(&scratch);
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_check(const dgfem_mvc *body) {
    return body ? dgfem_mvci_mesh_check(body->mesh) : DGFEM_ERROR_ARGUMENT;
}
