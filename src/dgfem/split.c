#pragma once
#include "mesh_build.c"
#include "split_face.c"
/* Plane split of elements of the cell complex; the stand-alone polyhedron is split as a complex of one element.

   Logic and geometry are kept apart. Each vertex is below, on or above the plane, decided once, and all else follows
   from these signs by counting: the parts close whatever round-off does to positions.

   - "On" counts as above, but no part without thickness comes of it: an element is split when it has vertices below and
     above, and a face or an edge in the plane belongs to the side that the interior next to it is on.
   - A crossing vertex is made once per edge, interpolated from the edge's lower index, and found again by hash.
   - A face with vertices below and above is cut along segments between its crossings. Along the cut line, upward and
     downward crossings are as many as each other; the k-th of the ones is joined to the k-th of the others:

             d1        u1     d2       u2       counter-clockwise, d = down, u = up:
          ----+--------+------+--------+----    u1 -> d1, u2 -> d2 close the part below,
               \ below/        \ below/         the same ones reversed close the part above

   - The edges in the plane that the part below is left with close into loops, which bound the new faces (caps) between
     below and above. A cap of several loops is split into regions, so that islands stay separate.

   All this appends to the mesh; only the commit at the end, which cannot fail, changes what was there. */

/* ---- cutting an element ---- */

/* A face that is not cut goes where its vertices are; one in the plane, to the side of the element's interior. */
static dgfem_status dgfemi_split_sort_whole(dgfemi_splitter *s, int code, const dgfemi_face_signs *signs) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    int below = signs->below > 0, ok;
    if (signs->below == 0 && signs->above == 0) {
        dgfem_real up = dgfemi_dot(s->mesh->faces[code / 2].normal, s->normal);
        below = code % 2 ? up < 0 : up > 0;
        s->coplanar = 1;
    }
    ok = dgfemi_push(hooks, below ? &s->below : &s->above, code);
    if (ok && below && signs->on > 1) ok = dgfemi_push(hooks, &s->touching, code);
    return ok ? DGFEM_OK : DGFEM_ERROR_MEMORY;
}

static dgfem_status dgfemi_split_sort_cut(dgfemi_splitter *s, int code, const dgfemi_face_signs *signs) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    dgfemi_cut_face cut;
    dgfem_status status = dgfemi_split_cut_face(s, code / 2, signs->simple, &cut);
    int i, ok = 1, inwards = code % 2, known = cut.p != DGFEM_NONE;
    if (status) return status;
    for (i = 0; ok && i < cut.below; i++) {
        ok = dgfemi_push(hooks, &s->below, 2 * (cut.first + i) + inwards);
        if (ok && !known) ok = dgfemi_push(hooks, &s->touching, 2 * (cut.first + i) + inwards);
    }
    for (i = 0; ok && i < cut.above; i++) ok = dgfemi_push(hooks, &s->above, 2 * (cut.first + cut.below + i) + inwards);
    if (ok && known) ok = dgfemi_segment_push(hooks, &s->caps, inwards ? cut.p : cut.q, inwards ? cut.q : cut.p);
    return ok ? DGFEM_OK : DGFEM_ERROR_MEMORY;
}

/* Fills s->below, s->above, s->touching, s->caps. */
static dgfem_status dgfemi_split_sort_faces(dgfemi_splitter *s, int element) {
    const dgfem_mesh *mesh = s->mesh;
    dgfem_element e = mesh->elements[element];
    dgfem_status status = DGFEM_OK;
    int k;
    s->below.count = s->above.count = s->touching.count = s->caps.count = 0;
    s->coplanar = 0;
    for (k = e.face_start; !status && k < e.face_start + e.face_count; k++) {
        int f = mesh->element_faces[k], code = 2 * f + (mesh->faces[f].element[0] != element);
        dgfemi_face_signs signs = dgfemi_split_face_signs(s, f);
        if (signs.below > 0 && signs.above > 0) status = dgfemi_split_sort_cut(s, code, &signs);
        else status = dgfemi_split_sort_whole(s, code, &signs);
    }
    return status;
}

/* Adds to s->pieces the edges in the plane of a face below, as the caps have them: reversed. */
static int dgfemi_split_list_touching(dgfemi_splitter *s, int code) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_face *face = &mesh->faces[code / 2];
    int l, i;
    for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        int count = mesh->loops[l].count, a, b = loop[count - 1], on_a, on_b = dgfemi_split_sign(s, b) == 0;
        for (i = 0; i < count; i++) {
            a = b, on_a = on_b;
            b = loop[i], on_b = dgfemi_split_sign(s, b) == 0;
            if (on_a && on_b && !dgfemi_segment_push(&mesh->hooks, &s->pieces, code % 2 ? a : b, code % 2 ? b : a))
                return 0;
        }
    }
    return 1;
}

/* Closes both parts by caps, the faces *first <= f < *end. Until the commit they have the element on both sides. */
static dgfem_status dgfemi_split_add_caps(dgfemi_splitter *s, int element, int *first, int *end) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    dgfem_status status = DGFEM_OK;
    dgfem_face like;
    int i, count = 0;
    memset(&like, 0, sizeof like);
    like.element[0] = like.element[1] = element;
    like.tag = DGFEM_NONE;
    like.normal = s->normal;
    s->pieces.count = 0;
    for (i = 0; i < s->caps.count; i++)
        if (!dgfemi_segment_push(hooks, &s->pieces, s->caps.data[i].from, s->caps.data[i].to))
            return DGFEM_ERROR_MEMORY;
    for (i = 0; i < s->touching.count; i++)
        if (!dgfemi_split_list_touching(s, s->touching.data[i])) return DGFEM_ERROR_MEMORY;
    *first = s->mesh->face_count;
    if (s->pieces.count > 0) status = dgfemi_split_add_faces(s, &s->pieces, &like, first, &count);
    *end = *first + count;
    for (i = *first; !status && i < *end; i++)
        if (!dgfemi_push(hooks, &s->below, 2 * i) || !dgfemi_push(hooks, &s->above, 2 * i + 1))
            status = DGFEM_ERROR_MEMORY;
    return status;
}

/* ---- parts without thickness ---- */

/* 1 when some vertex of the face is off the plane. */
static int dgfemi_split_has_depth(const dgfemi_splitter *s, int face) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_face *f = &mesh->faces[face];
    int l, i;
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++)
        for (i = 0; i < mesh->loops[l].count; i++)
            if (dgfemi_split_sign(s, mesh->loop_vertices[mesh->loops[l].start + i]) != 0) return 1;
    return 0;
}

static void dgfemi_split_remove(dgfemi_ints *codes, int code) {
    int i, kept = 0;
    for (i = 0; i < codes->count; i++)
        if (codes->data[i] != code) codes->data[kept++] = codes->data[i];
    codes->count = kept;
}

/* Moves the faces, all but caps, of components without thickness to the other side, and counts them. */
static dgfem_status dgfemi_split_move_flat(dgfemi_splitter *s, dgfemi_ints *from, dgfemi_ints *to, int first_cap,
                                           int *moved) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    int k, i;
    *moved = 0;
    if (!dgfemi_parts_find(&s->parts, from)) return DGFEM_ERROR_MEMORY;
    for (i = 0; i < s->parts.count; i++) s->parts.parent[i] = 0; /* from here on: has thickness */
    for (k = 0; k < from->count; k++)
        if (dgfemi_split_has_depth(s, from->data[k] / 2)) s->parts.parent[s->parts.component[k]] = 1;
    s->scratch_a.count = 0;
    for (k = 0; k < from->count; k++)
        if (!s->parts.parent[s->parts.component[k]] && from->data[k] / 2 < first_cap &&
            !dgfemi_push(hooks, &s->scratch_a, from->data[k]))
            return DGFEM_ERROR_MEMORY;
    for (i = 0; i < s->scratch_a.count; i++) {
        int code = s->scratch_a.data[i];
        dgfemi_split_remove(from, code);
        dgfemi_split_remove(&s->touching, code);
        if (!dgfemi_push(hooks, to, code) || (to == &s->below && !dgfemi_push(hooks, &s->touching, code)))
            return DGFEM_ERROR_MEMORY;
    }
    *moved = s->scratch_a.count;
    return DGFEM_OK;
}

/* Caps; where they leave a part without thickness, caps again without it. Such a part comes from faces that are in the
   plane but for round-off or snapping, and it is anyone's guess on which side they are. */
static dgfem_status dgfemi_split_close(dgfemi_splitter *s, int element, int *first_cap, int *end_cap) {
    dgfem_mesh *mesh = s->mesh;
    int attempt, moved, loops = mesh->loop_count, loop_vertices = mesh->loop_vertex_count;
    for (attempt = 0; attempt < 4; attempt++) {
        dgfem_status status = dgfemi_split_add_caps(s, element, first_cap, end_cap);
        if (status || !s->coplanar) return status;
        status = dgfemi_split_move_flat(s, &s->below, &s->above, *first_cap, &moved);
        if (!status && !moved) status = dgfemi_split_move_flat(s, &s->above, &s->below, *first_cap, &moved);
        if (status || !moved) return status;
        for (; *end_cap > *first_cap; --*end_cap) {
            dgfemi_split_remove(&s->below, 2 * (*end_cap - 1));
            dgfemi_split_remove(&s->above, 2 * (*end_cap - 1) + 1);
        }
        mesh->face_count = *first_cap, mesh->loop_count = loops, mesh->loop_vertex_count = loop_vertices;
    }
    return dgfemi_fail(&mesh->hooks, DGFEM_ERROR_DEGENERATE, "element %d: a part of it lies in the plane", element);
}

/* ---- children ---- */

/* Adds the faces of one component, or all for DGFEM_NONE, as an element to come. */
static dgfem_status dgfemi_split_add_child(dgfemi_splitter *s, const dgfemi_ints *codes, int component,
                                           dgfemi_split_child child) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    int k;
    if (s->child_count == s->child_capacity) {
        void *grown = dgfemi_grow(hooks, s->children, &s->child_capacity, s->child_count + 1, sizeof(child));
        if (!grown) return DGFEM_ERROR_MEMORY;
        s->children = (dgfemi_split_child *)grown;
    }
    if (!dgfemi_split_room(hooks, &s->child_faces, codes->count)) return DGFEM_ERROR_MEMORY;
    child.face_start = s->child_faces.count;
    for (k = 0; k < codes->count; k++)
        if (component == DGFEM_NONE || s->parts.component[k] == component)
            s->child_faces.data[s->child_faces.count++] = codes->data[k];
    child.face_count = s->child_faces.count - child.face_start;
    s->children[s->child_count++] = child;
    return DGFEM_OK;
}

/* Refuses parts without volume. Negative is a void, but only where there is no cap: beyond a cap is the outside. */
static dgfem_status dgfemi_split_check_volumes(const dgfemi_splitter *s, const dgfemi_split_child *child) {
    const dgfemi_parts *parts = &s->parts;
    int k;
    for (k = 0; k < parts->code_count; k++) {
        int face = parts->codes[k] / 2, is_cap = face >= child->cap_start && face < child->cap_end;
        dgfem_real volume = parts->volume[parts->component[k]];
        if (!(volume > 0) && !(volume < 0 && !is_cap))
            return dgfemi_fail(&s->mesh->hooks, DGFEM_ERROR_DEGENERATE,
                               "element %d: the plane leaves a part of volume %g", child->parent, (double)volume);
    }
    return DGFEM_OK;
}

/* Adds each component of one side, with its voids, as an element to come. */
static dgfem_status dgfemi_split_add_components(dgfemi_splitter *s, const dgfemi_ints *codes,
                                                const dgfemi_split_child *child) {
    dgfem_status status;
    int i;
    if (!dgfemi_parts_find(&s->parts, codes) || !dgfemi_parts_measure(&s->parts)) return DGFEM_ERROR_MEMORY;
    if (s->parts.crowded)
        return dgfemi_fail(&s->mesh->hooks, DGFEM_ERROR_INVARIANT, "element %d: a part meets itself at an edge",
                           child->parent);
    status = dgfemi_split_check_volumes(s, child);
    if (!status) status = dgfemi_parts_attach_voids(&s->parts);
    for (i = 0; !status && i < s->parts.count; i++)
        if (s->parts.volume[i] > 0) status = dgfemi_split_add_child(s, codes, i, *child);
    return status;
}

static dgfem_status dgfemi_split_element(dgfemi_splitter *s, int element) {
    dgfemi_split_child child;
    dgfem_status status;
    memset(&child, 0, sizeof child);
    child.parent = child.element = element;
    status = dgfemi_split_sort_faces(s, element);
    if (!status) status = dgfemi_split_close(s, element, &child.cap_start, &child.cap_end);
    for (child.side = -1; !status && child.side < 2; child.side += 2) {
        const dgfemi_ints *codes = child.side < 0 ? &s->below : &s->above;
        if (s->components) status = dgfemi_split_add_components(s, codes, &child);
        else status = dgfemi_split_add_child(s, codes, DGFEM_NONE, child);
    }
    return status;
}

/* ---- what lies outside the split ---- */

/* An element outside with its cut faces replaced by their parts. */
static dgfem_status dgfemi_split_renew_element(dgfemi_splitter *s, int element) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_element *e = &mesh->elements[element];
    dgfemi_split_child child;
    int k, i;
    memset(&child, 0, sizeof child);
    child.parent = child.element = element;
    s->below.count = 0;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        int f = mesh->element_faces[k], is_cut = s->cut[f].generation == s->generation;
        int first = is_cut ? s->cut[f].first : f, count = is_cut ? s->cut[f].below + s->cut[f].above : 1;
        for (i = 0; i < count; i++)
            if (!dgfemi_push(&mesh->hooks, &s->below, 2 * (first + i))) return DGFEM_ERROR_MEMORY;
    }
    return dgfemi_split_add_child(s, &s->below, DGFEM_NONE, child);
}

static dgfem_status dgfemi_split_renew_neighbours(dgfemi_splitter *s) {
    const dgfem_mesh *mesh = s->mesh;
    dgfem_status status = DGFEM_OK;
    int i, side;
    for (i = 0; !status && i < s->cut_faces.count; i++)
        for (side = 0; !status && side < 2; side++) {
            int element = mesh->faces[s->cut_faces.data[i]].element[side];
            if (element == DGFEM_NONE || s->element_mark[element] == s->generation) continue;
            s->element_mark[element] = s->generation;
            status = dgfemi_split_renew_element(s, element);
        }
    return status;
}

/* The crossing vertex on an edge, or DGFEM_NONE. */
static int dgfemi_split_find_crossing(const dgfemi_splitter *s, int a, int b) {
    const dgfemi_edge_slot *slot;
    if (!s->local && dgfemi_split_sign(s, a) * dgfemi_split_sign(s, b) >= 0) return DGFEM_NONE; /* quick */
    slot = dgfemi_edge_map_at(&s->crossings, a, b);
    return dgfemi_edge_map_has(&s->crossings, slot) ? slot->value : DGFEM_NONE;
}

static int dgfemi_split_has_crossing(const dgfemi_splitter *s, const dgfem_face *face) {
    const dgfem_mesh *mesh = s->mesh;
    int l, i;
    for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        int count = mesh->loops[l].count;
        for (i = 0; i < count; i++)
            if (dgfemi_split_find_crossing(s, loop[i], loop[i + 1 < count ? i + 1 : 0]) != DGFEM_NONE) return 1;
    }
    return 0;
}

/* New loops for a face, with the vertices on its split edges. */
static dgfem_status dgfemi_split_reloop_face(dgfemi_splitter *s, int f) {
    dgfem_mesh *mesh = s->mesh;
    const dgfem_hooks *hooks = &mesh->hooks;
    dgfem_face face = mesh->faces[f];
    int l, i, first = mesh->loop_count;
    for (l = face.loop_start; l < face.loop_start + face.loop_count; l++) {
        dgfem_loop loop = mesh->loops[l];
        s->scratch_a.count = 0;
        for (i = 0; i < loop.count; i++) {
            int a = mesh->loop_vertices[loop.start + i];
            int crossing = dgfemi_split_find_crossing(s, a, mesh->loop_vertices[loop.start + (i + 1) % loop.count]);
            if (!dgfemi_push(hooks, &s->scratch_a, a)) return DGFEM_ERROR_MEMORY;
            if (crossing != DGFEM_NONE && !dgfemi_push(hooks, &s->scratch_a, crossing)) return DGFEM_ERROR_MEMORY;
        }
        if (dgfemi_mesh_add_loop(mesh, s->scratch_a.data, s->scratch_a.count) == DGFEM_NONE) return DGFEM_ERROR_MEMORY;
    }
    if (s->reloop_count == s->reloop_capacity) {
        void *grown =
            dgfemi_grow(hooks, s->reloops, &s->reloop_capacity, s->reloop_count + 1, sizeof(dgfemi_split_reloop));
        if (!grown) return DGFEM_ERROR_MEMORY;
        s->reloops = (dgfemi_split_reloop *)grown;
    }
    s->reloops[s->reloop_count].face = f;
    s->reloops[s->reloop_count++].loop_start = first;
    return DGFEM_OK;
}

/* Enters the crossing vertices into the loops of faces that were not cut but run along a split edge: those of elements
   that touch the split ones at that edge alone, too. */
static dgfem_status dgfemi_split_reloop_faces(dgfemi_splitter *s) {
    dgfem_status status = DGFEM_OK;
    int f;
    for (f = 0; !status && f < s->face_count; f++) {
        const dgfem_face *face = &s->mesh->faces[f];
        if (face->element[0] == DGFEM_NONE || s->cut[f].generation == s->generation) continue;
        if (dgfemi_split_has_crossing(s, face)) status = dgfemi_split_reloop_face(s, f);
    }
    return status;
}

/* The same by way of the split edges alone. */
static dgfem_status dgfemi_split_reloop_near(dgfemi_splitter *s) {
    dgfem_status status = DGFEM_OK;
    int i, entry;
    for (i = 0; !status && i < s->crossed.count; i += 2)
        for (entry = s->incidence.head[s->crossed.data[i]]; !status && entry != DGFEM_NONE;
             entry = s->incidence.entries.data[entry + 1]) {
            int f = s->incidence.entries.data[entry];
            if (f >= s->face_count || s->mesh->faces[f].element[0] == DGFEM_NONE) continue;
            if (s->cut[f].generation == s->generation) continue; /* cut, or relooped before */
            if (!dgfemi_split_has_crossing(s, &s->mesh->faces[f])) continue;
            memset(&s->cut[f], 0, sizeof s->cut[f]);
            s->cut[f].generation = s->generation;
            status = dgfemi_split_reloop_face(s, f);
        }
    return status;
}

/* ---- commit ---- */

/* Puts a child where its parent was on one side of a face. A cap has the parent on both sides, below on side 0. */
static void dgfemi_split_set_side(dgfem_mesh *mesh, const dgfemi_split_child *child, int face) {
    dgfem_face *f = &mesh->faces[face];
    if (face >= child->cap_start && face < child->cap_end) f->element[child->side > 0] = child->element;
    else f->element[f->element[0] == child->parent ? 0 : 1] = child->element;
}

/* The first child of each parent takes its place, the others are appended. There is room for all. */
static void dgfemi_split_commit_children(dgfemi_splitter *s) {
    dgfem_mesh *mesh = s->mesh;
    int c, k, last_parent = DGFEM_NONE;
    for (c = 0; c < s->child_count; c++) {
        dgfemi_split_child *child = &s->children[c];
        dgfem_element *element;
        if (child->parent == last_parent) {
            child->element = mesh->element_count++;
            mesh->elements[child->element] = mesh->elements[child->parent];
        }
        last_parent = child->parent;
        element = &mesh->elements[child->element];
        element->face_start = mesh->element_face_count;
        element->face_count = child->face_count;
        for (k = child->face_start; k < child->face_start + child->face_count; k++) {
            int face = s->child_faces.data[k] / 2;
            mesh->element_faces[mesh->element_face_count++] = face;
            if (child->element != child->parent || face >= s->face_count) dgfemi_split_set_side(mesh, child, face);
        }
    }
}

static dgfem_status dgfemi_split_commit(dgfemi_splitter *s) {
    dgfem_mesh *mesh = s->mesh;
    int i;
    if (!dgfemi_mesh_reserve(mesh, 0, 0, s->child_count, 0, 0, s->child_faces.count)) return DGFEM_ERROR_MEMORY;
    dgfemi_split_commit_children(s);
    for (i = 0; i < s->cut_faces.count; i++) {
        dgfem_face *face = &mesh->faces[s->cut_faces.data[i]];
        face->element[0] = face->element[1] = DGFEM_NONE;
    }
    for (i = 0; i < s->reloop_count; i++) mesh->faces[s->reloops[i].face].loop_start = s->reloops[i].loop_start;
    if (!s->measure) return DGFEM_OK;
    for (i = s->face_count; i < mesh->face_count; i++) dgfemi_mesh_measure_face(mesh, i);
    for (i = 0; i < s->reloop_count; i++) dgfemi_mesh_measure_face(mesh, s->reloops[i].face);
    for (i = 0; i < s->child_count; i++) dgfemi_mesh_measure_element(mesh, s->children[i].element);
    return DGFEM_OK;
}

/* ---- the split ---- */

/* Room for the extents of all faces; those of new faces are not known. 1 on success, 0 when out of memory. */
static int dgfemi_split_fit_extents(dgfemi_splitter *s) {
    const dgfem_mesh *mesh = s->mesh;
    void *extent = s->extent;
    int ok = dgfemi_mesh_room(&mesh->hooks, &extent, 0, &s->extent_capacity, 2 * mesh->face_count, sizeof(dgfem_real));
    s->extent = (dgfem_real *)extent;
    for (; ok && s->extent_count < mesh->face_count; s->extent_count++)
        s->extent[2 * s->extent_count] = 1, s->extent[2 * s->extent_count + 1] = 0;
    return ok;
}

/* Empties what a call fills and remembers where the mesh ends. */
static dgfem_status dgfemi_split_begin(dgfemi_splitter *s) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_hooks *hooks = &mesh->hooks;
    void *cut = s->cut, *marks = s->element_mark;
    int ok = dgfemi_fit_zero(hooks, &cut, &s->cut_capacity, mesh->face_count, sizeof(dgfemi_cut_face));
    s->cut = (dgfemi_cut_face *)cut;
    ok = ok && dgfemi_fit_zero(hooks, &marks, &s->element_mark_capacity, mesh->element_count, sizeof(unsigned));
    s->element_mark = (unsigned *)marks;
    ok = ok && (s->axis == DGFEM_NONE || dgfemi_split_fit_extents(s));
    s->vertex_count = mesh->vertex_count, s->face_count = mesh->face_count;
    s->loop_count = mesh->loop_count, s->loop_vertex_count = mesh->loop_vertex_count;
    s->child_count = s->reloop_count = 0;
    s->child_faces.count = s->cut_faces.count = s->crossed.count = 0;
    ok = ok && (!s->local || dgfemi_incidence_grow(mesh, &s->incidence)); /* the first time: all faces */
    if (++s->generation == 0) {
        memset(s->cut, 0, (size_t)s->cut_capacity * sizeof(dgfemi_cut_face));
        memset(s->element_mark, 0, (size_t)s->element_mark_capacity * sizeof(unsigned));
        s->generation = 1;
    }
    return ok && dgfemi_edge_map_begin(hooks, &s->crossings, s->crossings.size / 2) ? DGFEM_OK : DGFEM_ERROR_MEMORY;
}

/* Forgets all that was appended. */
static void dgfemi_split_roll_back(dgfemi_splitter *s) {
    dgfem_mesh *mesh = s->mesh;
    mesh->vertex_count = s->vertex_count, mesh->face_count = s->face_count;
    mesh->loop_count = s->loop_count, mesh->loop_vertex_count = s->loop_vertex_count;
}

/* Enters the new vertices of faces that got new loops. 1 on success, 0 when out of memory. */
static int dgfemi_split_grow_incidence(dgfemi_splitter *s) {
    int i, ok = dgfemi_incidence_grow(s->mesh, &s->incidence);
    for (i = 0; ok && i < s->reloop_count; i++)
        ok = dgfemi_incidence_enter(s->mesh, &s->incidence, s->reloops[i].face, s->vertex_count);
    return ok;
}

/* Brings the surroundings up to date and commits, or forgets all that was done. */
static dgfem_status dgfemi_split_end(dgfemi_splitter *s, dgfem_status status) {
    if (!status && !s->all) status = dgfemi_split_renew_neighbours(s);
    if (!status && !s->all) status = s->local ? dgfemi_split_reloop_near(s) : dgfemi_split_reloop_faces(s);
    if (!status) status = dgfemi_split_commit(s);
    if (status) dgfemi_split_roll_back(s);
    else if (s->local && !dgfemi_split_grow_incidence(s)) status = DGFEM_ERROR_MEMORY; /* the mesh is a copy */
    return status == DGFEM_ERROR_MEMORY ? dgfemi_fail_memory(&s->mesh->hooks) : status;
}

/* Splits elements that all have vertices below and above the plane that is set. Their children are s->children[]; the
   first one of each parent is below and keeps the parent's index. On failure the mesh is as it was. */
static dgfem_status dgfemi_split_straddling(dgfemi_splitter *s, const int *elements, int count) {
    dgfem_status status = dgfemi_split_begin(s);
    int i;
    for (i = 0; !status && i < count; i++) {
        s->element_mark[elements[i]] = s->generation;
        status = dgfemi_split_element(s, elements[i]);
        s->failed_element = elements[i];
    }
    return dgfemi_split_end(s, status);
}

/* Cuts faces that all have vertices below and above the plane that is set; elements stay whole. The parts of face f are
   s->cut[f].first and those after it. On failure the mesh is as it was. */
static dgfem_status dgfemi_split_faces(dgfemi_splitter *s, const int *faces, int count) {
    dgfem_status status = dgfemi_split_begin(s);
    dgfemi_cut_face cut;
    int i;
    for (i = 0; !status && i < count; i++) {
        dgfemi_face_signs signs = dgfemi_split_count_signs(s, &s->mesh->faces[faces[i]]);
        status = dgfemi_split_cut_face(s, faces[i], signs.simple, &cut);
    }
    return dgfemi_split_end(s, status);
}

/* ---- axis planes ---- */

/* Prepares for planes across an axis. 1 on success, 0 when out of memory. */
static int dgfemi_split_set_axis(dgfemi_splitter *s, int axis) {
    const dgfem_mesh *mesh = s->mesh;
    void *height = s->height;
    int v, ok = dgfemi_mesh_room(&mesh->hooks, &height, 0, &s->height_capacity, mesh->vertex_count, sizeof(dgfem_real));
    s->height = (dgfem_real *)height;
    if (!ok) return 0;
    s->axis = axis;
    s->normal = dgfemi_vec3(axis == 0, axis == 1, axis == 2);
    s->snapped = 0;
    s->extent_count = 0;
    for (v = 0; v < mesh->vertex_count; v++) s->height[v] = dgfemi_axis(mesh->vertices[v], axis);
    return dgfemi_split_fit_extents(s);
}

/* ---- any plane ---- */

static void dgfemi_split_set_height(dgfemi_splitter *s, int vertex, dgfem_real *size) {
    dgfem_vec3 p = s->mesh->vertices[vertex], n = s->plane.normal;
    *size = dgfemi_max(*size, dgfemi_abs(n.x * p.x) + dgfemi_abs(n.y * p.y) + dgfemi_abs(n.z * p.z));
    s->height[vertex] = dgfemi_dot(n, p) - s->plane.offset;
}

static void dgfemi_split_set_element_heights(dgfemi_splitter *s, int element, dgfem_real *size) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_element *e = &mesh->elements[element];
    int k, l, i;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            for (i = 0; i < mesh->loops[l].count; i++)
                dgfemi_split_set_height(s, mesh->loop_vertices[mesh->loops[l].start + i], size);
    }
}

/* Heights above the plane, of all vertices or, for a local split, of those of the given elements. What round-off alone
   may have put beside the plane counts as on it, so that a second cut where there is one already changes nothing. 1 on
   success, 0 when out of memory. */
static int dgfemi_split_set_plane(dgfemi_splitter *s, dgfem_plane plane, const int *elements, int count) {
    const dgfem_mesh *mesh = s->mesh;
    dgfem_vec3 n = plane.normal;
    dgfem_real size = dgfemi_abs(plane.offset);
    void *height = s->height;
    int v, i,
        ok = dgfemi_mesh_room(&mesh->hooks, &height, 0, &s->height_capacity, mesh->vertex_count, sizeof(dgfem_real));
    s->height = (dgfem_real *)height;
    if (!ok) return 0;
    s->axis = DGFEM_NONE;
    s->plane = plane;
    s->normal = dgfemi_abs(dgfemi_dot(n, n) - 1) <= 4 * DGFEM_EPSILON ? n : dgfemi_normalized(n);
    s->snapped = 0;
    if (s->local)
        for (i = 0; i < count; i++) dgfemi_split_set_element_heights(s, elements[i], &size);
    else
        for (v = 0; v < mesh->vertex_count; v++) dgfemi_split_set_height(s, v, &size);
    s->high = 16 * DGFEM_EPSILON * size;
    s->low = -s->high;
    return 1;
}

static void dgfemi_split_mark_edge(dgfemi_splitter *s, int a, int b) {
    dgfem_real height_a = dgfemi_abs(s->height[a]), height_b = dgfemi_abs(s->height[b]);
    if (dgfemi_split_sign(s, a) * dgfemi_split_sign(s, b) >= 0) return;
    if (height_a < s->snap * height_b && s->snap_mark[a] == 0) s->snap_mark[a] = 1;
    if (height_b < s->snap * height_a && s->snap_mark[b] == 0) s->snap_mark[b] = 1;
}

/* Marks the vertices of an element that are near the plane compared with the other end of an edge that crosses it. */
static void dgfemi_split_mark_element(dgfemi_splitter *s, int element) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_element *e = &mesh->elements[element];
    int k, l, i;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
            const int *loop = mesh->loop_vertices + mesh->loops[l].start;
            int count = mesh->loops[l].count;
            for (i = 0; i < count; i++) dgfemi_split_mark_edge(s, loop[i], loop[i + 1 < count ? i + 1 : 0]);
        }
    }
}

static int dgfemi_split_straddles(const dgfemi_splitter *s, int element) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_element *e = &mesh->elements[element];
    int k, below = 0, above = 0;
    for (k = e->face_start; k < e->face_start + e->face_count && !(below && above); k++) {
        dgfemi_face_signs signs = dgfemi_split_count_signs(s, &mesh->faces[mesh->element_faces[k]]);
        below |= signs.below, above |= signs.above;
    }
    return below && above;
}

/* 1 when the vertices strictly between corners `first` and `end` of a loop lie on the line through these two. */
static int dgfemi_split_is_straight(const dgfemi_splitter *s, const int *loop, int count, int first, int end) {
    const dgfem_vec3 *vertices = s->mesh->vertices;
    dgfem_vec3 a = vertices[loop[first % count]], along = dgfemi_sub(vertices[loop[end % count]], a);
    dgfem_real tolerance = 4 * s->high / dgfemi_norm(s->plane.normal) * dgfemi_norm(along);
    int i;
    for (i = first + 1; i < end; i++)
        if (!(dgfemi_norm(dgfemi_cross(dgfemi_sub(vertices[loop[i % count]], a), along)) <= tolerance)) return 0;
    return 1;
}

/* Where both ends of a straight run of edges are on the plane, or marked, so are the vertices between them: with them
   beside it the run would enclose a sliver without area. Returns the number of new marks. */
static int dgfemi_split_mark_runs(dgfemi_splitter *s, const int *loop, int count) {
    int first, end, i, marks = 0;
    for (first = 0; first < count; first++) {
        if (s->snap_mark[loop[first]] != 1 && dgfemi_split_sign(s, loop[first]) != 0) continue;
        for (end = first + 1; end < first + count; end++)
            if (s->snap_mark[loop[end % count]] == 1 || dgfemi_split_sign(s, loop[end % count]) == 0) break;
        if (end == first + 1 || end == first + count || !dgfemi_split_is_straight(s, loop, count, first, end)) continue;
        for (i = first + 1; i < end; i++)
            if (s->snap_mark[loop[i % count]] == 0) s->snap_mark[loop[i % count]] = 1, marks++;
    }
    return marks;
}

static int dgfemi_split_mark_runs_of(dgfemi_splitter *s, int element) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_element *e = &mesh->elements[element];
    int k, l, marks = 0;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            marks += dgfemi_split_mark_runs(s, mesh->loop_vertices + mesh->loops[l].start, mesh->loops[l].count);
    }
    return marks;
}

/* Makes all marks zero. 1 on success, 0 when out of memory. */
static int dgfemi_split_clear_marks(dgfemi_splitter *s) {
    const dgfem_mesh *mesh = s->mesh;
    void *snap_mark = s->snap_mark;
    int ok = dgfemi_mesh_room(&mesh->hooks, &snap_mark, 0, &s->snap_mark_capacity, mesh->vertex_count, 1);
    s->snap_mark = (signed char *)snap_mark;
    if (ok && mesh->vertex_count > 0) memset(s->snap_mark, 0, (size_t)mesh->vertex_count);
    return ok;
}

/* Puts the vertices of the elements that are to be snapped on the plane. */
static void dgfemi_split_snap(dgfemi_splitter *s, const int *elements, int count) {
    int i, v, marks;
    for (v = 0; v < s->mesh->vertex_count; v++)
        if (s->snap_mark[v] == 1) s->snap_mark[v] = 0;
    for (i = 0; i < count; i++) dgfemi_split_mark_element(s, elements ? elements[i] : i);
    do {
        for (marks = 0, i = 0; i < count; i++) marks += dgfemi_split_mark_runs_of(s, elements ? elements[i] : i);
    } while (marks > 0);
    for (v = 0; v < s->mesh->vertex_count; v++)
        if (s->snap_mark[v] == 1) s->height[v] = 0, s->snapped = 1;
}

/* Sets the plane and selects those of the elements (NULL: of the first `count`) that straddle it. */
static dgfem_status dgfemi_split_select(dgfemi_splitter *s, dgfem_plane plane, const int *elements, int count) {
    int i;
    if (!dgfemi_split_set_plane(s, plane, elements, count)) return dgfemi_fail_memory(&s->mesh->hooks);
    if (s->snap > 0) dgfemi_split_snap(s, elements, count);
    s->selected.count = 0;
    for (i = 0; i < count; i++) {
        int element = elements ? elements[i] : i;
        if (dgfemi_split_straddles(s, element) && !dgfemi_push(&s->mesh->hooks, &s->selected, element))
            return dgfemi_fail_memory(&s->mesh->hooks);
    }
    return DGFEM_OK;
}

/* One attempt; where vertices were snapped it fails silently. */
static dgfem_status dgfemi_split_try(dgfemi_splitter *s, dgfem_plane plane, const int *elements, int count) {
    dgfem_hooks hooks = s->mesh->hooks;
    dgfem_status status = dgfemi_split_select(s, plane, elements, count);
    if (status) return status;
    if (s->snapped) s->mesh->hooks.log = NULL;
    status = dgfemi_split_straddling(s, s->selected.data, s->selected.count);
    s->mesh->hooks.log = hooks.log;
    return s->snapped && status == DGFEM_ERROR_MEMORY ? dgfemi_fail_memory(&hooks) : status;
}

/* Forbids to snap the vertices of an element. */
static void dgfemi_split_release(dgfemi_splitter *s, int element) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_element *e = &mesh->elements[element];
    int k, l, i;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            for (i = 0; i < mesh->loops[l].count; i++) s->snap_mark[mesh->loop_vertices[mesh->loops[l].start + i]] = -1;
    }
}

/* Splits those of the given elements (NULL: of the first `count`) that straddle the plane, in place; they are
   s->selected, their children s->children. On failure the mesh is as it was. Leaves dead items. An element that does not
   take the snapping well keeps its vertices off the plane. */
static dgfem_status dgfemi_split_elements(dgfemi_splitter *s, dgfem_plane plane, const int *elements, int count) {
    enum { MAX_RELEASES = 16 };
    dgfem_real snap = s->snap;
    dgfem_status status;
    int releases;
    if (snap > 0 && !dgfemi_split_clear_marks(s)) return dgfemi_fail_memory(&s->mesh->hooks);
    status = dgfemi_split_try(s, plane, elements, count);
    for (releases = 1; status && status != DGFEM_ERROR_MEMORY && s->snapped; releases++) {
        dgfemi_split_release(s, s->failed_element);
        if (releases == MAX_RELEASES) s->snap = 0;
        status = dgfemi_split_try(s, plane, elements, count);
    }
    s->snap = snap;
    return status;
}

static dgfem_status dgfemi_split_check_plane(const dgfem_hooks *hooks, dgfem_plane plane) {
    dgfem_vec3 n = plane.normal;
    if (!dgfemi_is_finite3(n) || !dgfemi_is_finite(plane.offset))
        return dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "plane: normal %g %g %g, offset %g", (double)n.x, (double)n.y,
                           (double)n.z, (double)plane.offset);
    if (!(dgfemi_norm(n) > 0)) return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "plane: its normal is zero");
    return DGFEM_OK;
}

/* On a copy, because the compaction, too, can fail. */
static dgfem_status dgfemi_mesh_split(dgfem_mesh *mesh, dgfem_plane plane, dgfem_real snap, int *split) {
    dgfem_mesh *copy = dgfemi_mesh_duplicate(mesh);
    dgfemi_splitter s;
    dgfem_status status;
    if (!copy) return dgfemi_fail_memory(&mesh->hooks);
    s = dgfemi_splitter_make(copy);
    s.snap = snap;
    s.components = s.all = s.measure = 1;
    status = dgfemi_split_elements(&s, plane, NULL, copy->element_count);
    if (!status && s.selected.count > 0) status = dgfemi_mesh_compact(copy);
    if (!status) {
        *split = s.selected.count;
        dgfemi_mesh_swap(mesh, copy);
    }
    dgfemi_splitter_free(&s);
    dgfem_mesh_destroy(copy);
    return status;
}

DGFEM_API dgfem_status dgfem_mesh_split_plane(dgfem_mesh *mesh, dgfem_plane plane, dgfem_real snap, int *split) {
    dgfem_status status;
    int count = 0;
    if (split) *split = 0;
    if (!mesh) return DGFEM_ERROR_ARGUMENT;
    status = dgfemi_split_check_plane(&mesh->hooks, plane);
    if (status) return status;
    if (!(snap >= 0) || !(snap < 1))
        return dgfemi_fail(&mesh->hooks, DGFEM_ERROR_ARGUMENT, "snap %g is not in [0, 1)", (double)snap);
    status = dgfemi_mesh_split(mesh, plane, snap, &count);
    if (!status && split) *split = count;
    return status;
}

/* ---- the stand-alone polyhedron ---- */

/* The polyhedron as a mesh of one element, not measured; NULL when out of memory. */
static dgfem_mesh *dgfemi_polyhedron_to_mesh(const dgfem_polyhedron *polyhedron) {
    dgfem_mesh *mesh = dgfemi_mesh_new(&polyhedron->hooks);
    int faces = polyhedron->face_count, loops = polyhedron->face_loops[faces], f, l, v;
    if (!mesh) return NULL;
    if (!dgfemi_mesh_reserve(mesh, polyhedron->vertex_count, faces, 1, loops, polyhedron->loop_start[loops], faces)) {
        dgfem_mesh_destroy(mesh);
        return NULL;
    }
    for (v = 0; v < polyhedron->vertex_count; v++) (void)dgfemi_mesh_add_vertex(mesh, polyhedron->vertices[v]);
    for (f = 0; f < faces; f++) {
        int first = polyhedron->face_loops[f], end = polyhedron->face_loops[f + 1];
        for (l = first; l < end; l++)
            (void)dgfemi_mesh_add_loop(mesh, polyhedron->loop_vertices + polyhedron->loop_start[l],
                                       polyhedron->loop_start[l + 1] - polyhedron->loop_start[l]);
        (void)dgfemi_mesh_add_face(mesh, first, end - first, 0, DGFEM_NONE, f, dgfemi_vec3(0, 0, 0));
        mesh->faces[f].normal = dgfemi_mesh_unit_normal(mesh, f);
        mesh->element_faces[f] = f;
    }
    mesh->element_face_count = faces;
    mesh->element_count = 1;
    memset(mesh->elements, 0, sizeof(dgfem_element));
    mesh->elements[0].face_count = faces;
    return mesh;
}

/* Every directed edge of the only element must have its opposite: else a cut does not close. */
static dgfem_status dgfemi_split_check_closed(const dgfem_mesh *mesh) {
    const dgfem_hooks *hooks = &mesh->hooks;
    dgfem_status status = DGFEM_OK;
    dgfemi_edges edges;
    int f, i;
    memset(&edges, 0, sizeof edges);
    if (!dgfemi_edges_reset(hooks, &edges, mesh->loop_vertex_count)) status = dgfemi_fail_memory(hooks);
    for (f = 0; !status && f < mesh->face_count; f++) dgfemi_edges_add_face(mesh, &edges, f, 1);
    for (i = 0; !status && i < edges.count; i++) {
        const dgfemi_edge *edge = &edges.data[i];
        if (edge->forward != edge->backward)
            status = dgfemi_fail(hooks, DGFEM_ERROR_OPEN, "edge from vertex %d to %d occurs %d times, its opposite %d",
                                 edge->a, edge->b, edge->forward, edge->backward);
    }
    dgfemi_edges_free(hooks, &edges);
    return status;
}

/* The parts of a mesh of one element, each with all its components. */
static dgfem_status dgfemi_split_parts(dgfem_mesh *mesh, dgfem_plane plane, dgfem_polyhedron *parts[2]) {
    dgfemi_splitter s = dgfemi_splitter_make(mesh);
    dgfem_status status;
    int i, element = 0;
    s.all = 1;
    status = dgfemi_split_elements(&s, plane, &element, 1);
    if (!status && s.selected.count > 0) {
        status = dgfem_mesh_element_polyhedron(mesh, 0, &parts[0]);
        if (!status) status = dgfem_mesh_element_polyhedron(mesh, 1, &parts[1]);
    } else if (!status) {
        for (i = 0; i < mesh->loop_vertex_count && dgfemi_split_sign(&s, mesh->loop_vertices[i]) >= 0; i++) {
        }
        status = dgfem_mesh_element_polyhedron(mesh, 0, &parts[i == mesh->loop_vertex_count]);
    }
    dgfemi_splitter_free(&s);
    return status;
}

DGFEM_API dgfem_status dgfem_polyhedron_split(const dgfem_polyhedron *polyhedron, dgfem_plane plane,
                                              dgfem_polyhedron **below, dgfem_polyhedron **above) {
    dgfem_polyhedron *parts[2] = {NULL, NULL};
    dgfem_mesh *mesh;
    dgfem_status status;
    if (below) *below = NULL;
    if (above) *above = NULL;
    if (!polyhedron || !below || !above) return DGFEM_ERROR_ARGUMENT;
    status = dgfemi_split_check_plane(&polyhedron->hooks, plane);
    if (status) return status;
    mesh = dgfemi_polyhedron_to_mesh(polyhedron);
    if (!mesh) return dgfemi_fail_memory(&polyhedron->hooks);
    status = dgfemi_split_check_closed(mesh);
    if (!status) status = dgfemi_split_parts(mesh, plane, parts);
    dgfem_mesh_destroy(mesh);
    if (status) {
        dgfem_polyhedron_destroy(parts[0]);
        dgfem_polyhedron_destroy(parts[1]);
        return status;
    }
    *below = parts[0], *above = parts[1];
    return DGFEM_OK;
}
