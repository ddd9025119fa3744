#pragma once
#include "build.c"
/* Splitting elements by a plane.

   Nodes are below (-1), on (0) or above (1) the plane. A node near the crossing of one of its edges counts as on it, in
   place: so no short edges are made, and the parts meet the plane only nearly. Every crossed edge of an element that is
   split gets one node, in the loops of all faces that have this edge, so that neighbours gain a hanging node:

        + ----- + ------- +          The faces between are divided for both their elements; the new face closes the
        |       |         |          boundary of the faces above. Where a part is not star-shaped, the attempt is
        o ----- o         |          dropped, and repeated with less snapping at the element that failed, then
        |       |         |          without splitting it, at last with nothing new on any of its edges. */

/* The least snapping: what a crossing nearer to a node than this part of its edge cuts off is too flat to be a part. */
#if DGFEM_REAL_IS_FLOAT
#define DGFEM_MVC_TIE 1e-4
#else
#define DGFEM_MVC_TIE 1e-6
#endif

/* Signed distances of nodes from a blade. Zeroed memory is empty. */
typedef struct dgfem_mvci_levels {
    dgfem_real *value;
    signed char *sign; /* of the value, or 0 where the node counts as on the blade */
    int count, capacity;
} dgfem_mvci_levels;

/* What is asked of an element, the more the more often it has failed. Stages below DGFEM_MVCI_WHOLE lower the tolerance
   of its nodes, the last of them to the least. */
enum {
    DGFEM_MVCI_WHOLE = 5, /* stays whole: it is not split, and its faces are not divided */
    DGFEM_MVCI_SEALED     /* gets no new node, either; so all elements that share an edge with it stay whole */
};

/* One attempt, and what earlier ones have learned. */
typedef struct dgfem_mvci_splitter {
    const dgfem_hooks *hooks;
    dgfem_plane plane; /* unit normal */
    int current;       /* 1: the plane is meant in the current positions; 0: at rest */
    dgfem_real snap;
    dgfem_real *tolerance; /* [nodes before] part of a crossed edge within which the node counts as on the plane */
    char *stage;           /* [elements before] */
    const dgfem_mvci_mesh *before;
    int node_count, element_count; /* before the attempt */
    dgfem_mvci_levels levels;
    dgfem_mvci_ints parent;   /* element before the attempt that an element is part of */
    dgfem_mvci_ints failed;   /* elements before the attempt */
    dgfem_mvci_ints selected; /* elements to split */
    dgfem_mvci_ints buffer, list, group, root, bound;
    dgfem_mvci_edges crossings, sides;
    dgfem_mvci_edges sealed; /* edges of elements at the last stage */
    int elements_split, elements_kept, nodes_added;
} dgfem_mvci_splitter;

static int dgfem_mvci_sign(dgfem_real x) { return (x > 0) - (x < 0); }

static int dgfem_mvci_levels_room(const dgfem_hooks *hooks, dgfem_mvci_levels *levels, int count) {
    if (count > levels->capacity) {
        int capacity = levels->capacity, other = capacity, extra = count - levels->count;
        void *value = levels->value, *sign = levels->sign;
        int ok = dgfem_mvci_room(hooks, &value, levels->count, &capacity, extra, sizeof(dgfem_real)) &&
                 dgfem_mvci_room(hooks, &sign, levels->count, &other, extra, 1);
        levels->value = (dgfem_real *)value, levels->sign = (signed char *)sign;
        if (!ok) return 0;
        levels->capacity = capacity;
    }
    for (; levels->count < count; levels->count++) levels->value[levels->count] = 0, levels->sign[levels->count] = 0;
    return 1;
}

static void dgfem_mvci_levels_free(const dgfem_hooks *hooks, dgfem_mvci_levels *levels) {
    dgfem_mvci_free(hooks, levels->value);
    dgfem_mvci_free(hooks, levels->sign);
}

static void dgfem_mvci_splitter_free(dgfem_mvci_splitter *s) {
    const dgfem_hooks *hooks = s->hooks;
    dgfem_mvci_free(hooks, s->tolerance);
    dgfem_mvci_free(hooks, s->stage);
    dgfem_mvci_levels_free(hooks, &s->levels);
    dgfem_mvci_free(hooks, s->parent.data);
    dgfem_mvci_free(hooks, s->failed.data);
    dgfem_mvci_free(hooks, s->selected.data);
    dgfem_mvci_free(hooks, s->buffer.data);
    dgfem_mvci_free(hooks, s->list.data);
    dgfem_mvci_free(hooks, s->group.data);
    dgfem_mvci_free(hooks, s->root.data);
    dgfem_mvci_free(hooks, s->bound.data);
    dgfem_mvci_free(hooks, s->crossings.slots);
    dgfem_mvci_free(hooks, s->sides.slots);
    dgfem_mvci_free(hooks, s->sealed.slots);
}

/* For all attempts on a mesh. 0 when out of memory. */
static int dgfem_mvci_splitter_make(dgfem_mvci_splitter *s, const dgfem_hooks *hooks, const dgfem_mvci_mesh *mesh,
                                    dgfem_plane plane, int current, dgfem_real snap) {
    memset(s, 0, sizeof *s);
    s->hooks = hooks;
    s->plane = plane;
    s->current = current;
    s->snap = dgfem_mvci_max(snap, (dgfem_real)DGFEM_MVC_TIE);
    s->node_count = mesh->node_count;
    s->element_count = mesh->element_count;
    s->tolerance = (dgfem_real *)dgfem_mvci_allocate(s->hooks, (size_t)mesh->node_count, sizeof(dgfem_real));
    s->stage = (char *)dgfem_mvci_allocate(s->hooks, (size_t)mesh->element_count, 1);
    s->before = mesh;
    for (int i = 0; s->tolerance && i < mesh->node_count; i++) s->tolerance[i] = s->snap;
    return s->tolerance && s->stage;
}

static const dgfem_vec3 *dgfem_mvci_blade_space(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh) {
    return s->current ? mesh->position : mesh->rest;
}

/* Element before the attempt. */
static int dgfem_mvci_element_before(const dgfem_mvci_splitter *s, int element) {
    return element < s->element_count ? element : s->parent.data[element - s->element_count];
}

static int dgfem_mvci_stays_whole(const dgfem_mvci_splitter *s, int element) {
    return s->stage[dgfem_mvci_element_before(s, element)] >= DGFEM_MVCI_WHOLE;
}

static int dgfem_mvci_is_sealed(const dgfem_mvci_splitter *s, int element) {
    return s->stage[dgfem_mvci_element_before(s, element)] == DGFEM_MVCI_SEALED;
}

static int dgfem_mvci_edge_is_sealed(const dgfem_mvci_splitter *s, int a, int b) {
    return s->sealed.size && dgfem_mvci_edges_find_between(&s->sealed, a, b) != DGFEM_NONE;
}

static int dgfem_mvci_add_failed(dgfem_mvci_splitter *s, int element) {
    int before = dgfem_mvci_element_before(s, element);
    for (int i = 0; i < s->failed.count; i++)
        if (s->failed.data[i] == before) return 1;
    return dgfem_mvci_push(s->hooks, &s->failed, before);
}

/* ---- which side nodes are on ---- */

/* Distances of all nodes; round-off counts as none. 0 when out of memory. */
static int dgfem_mvci_measure_levels(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh) {
    const dgfem_vec3 *x = dgfem_mvci_blade_space(s, mesh);
    dgfem_real size = dgfem_mvci_abs(s->plane.offset);
    s->levels.count = 0;
    if (!dgfem_mvci_levels_room(s->hooks, &s->levels, mesh->node_count)) return 0;
    for (int i = 0; i < mesh->node_count; i++) {
        s->levels.value[i] = dgfem_mvci_dot(s->plane.normal, x[i]) - s->plane.offset;
        size = dgfem_mvci_max(size, dgfem_mvci_norm(x[i]));
    }
    for (int i = 0; i < mesh->node_count; i++) {
        if (dgfem_mvci_abs(s->levels.value[i]) <= 64 * DGFEM_MVC_EPSILON * size) s->levels.value[i] = 0;
        s->levels.sign[i] = (signed char)dgfem_mvci_sign(s->levels.value[i]);
    }
    return 1;
}

static dgfem_real dgfem_mvci_node_tolerance(const dgfem_mvci_splitter *s, int node) {
    return node < s->node_count ? s->tolerance[node] : s->snap;
}

/* Puts the nodes of a face on the blade where it crosses an edge near them. */
static void dgfem_mvci_snap_face(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, int face,
                                 dgfem_mvci_levels *levels) {
    int count;
    const int *loop = dgfem_mvci_face_loop(mesh, face, &count);
    for (int i = 0; i < count; i++) {
        int a = loop[i], b = loop[(i + 1) % count];
        if (levels->sign[a] * levels->sign[b] >= 0) continue;
        dgfem_real t = levels->value[a] / (levels->value[a] - levels->value[b]);
        if (t <= dgfem_mvci_node_tolerance(s, a)) levels->sign[a] = 0;
        else if (1 - t <= dgfem_mvci_node_tolerance(s, b)) levels->sign[b] = 0;
    }
}

/* Puts nodes between two others of a face on the blade where these are and all lie nearly on a line: what would be cut
   off there has no height. Returns whether it did. */
static int dgfem_mvci_snap_between(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, int face,
                                   dgfem_mvci_levels *levels) {
    const dgfem_real least = (dgfem_real)(1000 * DGFEM_MVC_FLAT);
    int count, changed = 0;
    const int *loop = dgfem_mvci_face_loop(mesh, face, &count);
    for (int i = 0; i < count; i++) {
        int n = 1;
        if (levels->sign[loop[i]] || !levels->sign[loop[(i + 1) % count]]) continue;
        while (n < count && levels->sign[loop[(i + n) % count]]) n++;
        if (n >= count - 1) continue;
        dgfem_vec3 a = mesh->rest[loop[i]], d = dgfem_mvci_sub(mesh->rest[loop[(i + n) % count]], a);
        dgfem_real square = dgfem_mvci_dot(d, d);
        int flat = 1;
        for (int k = 1; k < n && flat; k++) {
            int node = loop[(i + k) % count];
            dgfem_real limit = dgfem_mvci_max(least, dgfem_mvci_node_tolerance(s, node) / 20);
            flat = dgfem_mvci_norm(dgfem_mvci_cross(d, dgfem_mvci_sub(mesh->rest[node], a))) <= limit * square;
        }
        if (!flat) continue;
        for (int k = 1; k < n; k++) levels->sign[loop[(i + k) % count]] = 0;
        changed = 1;
    }
    return changed;
}

/* Number of changes of side along a loop, nodes on the blade left out. */
static int dgfem_mvci_face_changes(const dgfem_mvci_mesh *mesh, int face, const dgfem_mvci_levels *levels) {
    int count, last = 0, first = 0, changes = 0;
    const int *loop = dgfem_mvci_face_loop(mesh, face, &count);
    for (int i = 0; i < count; i++) {
        int sign = levels->sign[loop[i]];
        if (!sign) continue;
        if (last && sign != last) changes++;
        if (!first) first = sign;
        last = sign;
    }
    return changes + (first != last);
}

static int dgfem_mvci_element_straddles(const dgfem_mvci_mesh *mesh, int element, const dgfem_mvci_levels *levels) {
    int face_count, above = 0, below = 0;
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    for (int k = 0; k < face_count && !(above && below); k++) {
        int count;
        const int *loop = dgfem_mvci_face_loop(mesh, faces[k] / 2, &count);
        for (int i = 0; i < count; i++) above |= levels->sign[loop[i]] > 0, below |= levels->sign[loop[i]] < 0;
    }
    return above && below;
}

/* ---- edges and faces ---- */

/* Snaps the nodes of the selected elements, and drops those that no longer straddle. */
static void dgfem_mvci_snap_selected(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh) {
    int changed = 1, kept = 0;
    for (int i = 0; i < s->selected.count; i++) {
        int face_count;
        const int *faces = dgfem_mvci_element_faces(mesh, s->selected.data[i], &face_count);
        for (int k = 0; k < face_count; k++) dgfem_mvci_snap_face(s, mesh, faces[k] / 2, &s->levels);
    }
    while (changed) {
        changed = 0;
        for (int i = 0; i < s->selected.count; i++) {
            int face_count;
            const int *faces = dgfem_mvci_element_faces(mesh, s->selected.data[i], &face_count);
            for (int k = 0; k < face_count; k++) changed |= dgfem_mvci_snap_between(s, mesh, faces[k] / 2, &s->levels);
        }
    }
    for (int i = 0; i < s->selected.count; i++)
        if (dgfem_mvci_element_straddles(mesh, s->selected.data[i], &s->levels))
            s->selected.data[kept++] = s->selected.data[i];
    s->selected.count = kept;
}

/* Divides faces of an element that the blade would cut into more than two. 0 when out of memory. */
static int dgfem_mvci_divide_crossed(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, int element) {
    for (int k = 0; k < mesh->elements[element].face_count; k++) {
        int face = mesh->element_faces.data[mesh->elements[element].face + k] / 2;
        if (dgfem_mvci_face_changes(mesh, face, &s->levels) <= 2) continue;
        int count = mesh->faces[face].triangle_count;
        s->buffer.count = 0;
        if (dgfem_mvci_append(s->hooks, &s->buffer, mesh->triangles.data + mesh->faces[face].triangle, 3 * count) ==
                DGFEM_NONE ||
            !dgfem_mvci_divide_face(mesh, face, s->buffer.data, count))
            return 0;
    }
    return 1;
}

/* A node where the blade crosses the edge from a to b; 0 when out of memory. */
static int dgfem_mvci_cross_edge(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, dgfem_mvci_levels *levels, int a,
                                 int b) {
    dgfem_mvci_edge *edge = dgfem_mvci_edges_between(&s->crossings, a, b);
    if (edge->value != DGFEM_NONE) return 1;
    dgfem_real t = levels->value[edge->a] / (levels->value[edge->a] - levels->value[edge->b]);
    edge->value = dgfem_mvci_add_node_between(mesh, edge->a, edge->b, t);
    s->nodes_added++;
    return edge->value != DGFEM_NONE && dgfem_mvci_levels_room(s->hooks, levels, mesh->node_count);
}

static int dgfem_mvci_cross_face(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, dgfem_mvci_levels *levels, int face) {
    for (int i = 0; i < mesh->faces[face].count; i++) {
        const int *loop = mesh->loops.data + mesh->faces[face].loop;
        int a = loop[i], b = loop[(i + 1) % mesh->faces[face].count];
        if (levels->sign[a] * levels->sign[b] < 0 && !dgfem_mvci_cross_edge(s, mesh, levels, a, b)) return 0;
    }
    return 1;
}

/* Puts the nodes of s->crossings into the loops of all faces that have their edges. 0 when out of memory. */
static int dgfem_mvci_insert_nodes(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh) {
    for (int f = 0; f < mesh->face_count; f++) {
        int count, found = 0;
        const int *loop = dgfem_mvci_face_loop(mesh, f, &count);
        if (mesh->faces[f].owner[0] == DGFEM_NONE) continue;
        s->buffer.count = 0;
        if (!dgfem_mvci_ints_room(s->hooks, &s->buffer, 2 * count)) return 0;
        for (int i = 0; i < count; i++) {
            int node = dgfem_mvci_edges_find_between(&s->crossings, loop[i], loop[(i + 1) % count]);
            s->buffer.data[s->buffer.count++] = loop[i];
            if (node != DGFEM_NONE) s->buffer.data[s->buffer.count++] = node, found = 1;
        }
        if (found && !dgfem_mvci_set_loop(mesh, f, s->buffer.data, s->buffer.count)) return 0;
    }
    return 1;
}

/* Position of the node nearest to the blade among `count` in a row, from `first` on. */
static int dgfem_mvci_nearest_level(const dgfem_mvci_levels *levels, const int *loop, int length, int first,
                                    int count) {
    int best = first;
    for (int i = 1; i < count; i++)
        if (dgfem_mvci_abs(levels->value[loop[(first + i) % length]]) <
            dgfem_mvci_abs(levels->value[loop[best % length]]))
            best = first + i;
    return best;
}

/* Divides a face, with two changes of side and nodes on the blade at both, by a chord between these. The part above
   stays in place. Returns the part below; the face itself where a part would be turned over, for it is not convex and
   the chord outside: nothing has changed then; DGFEM_NONE when out of memory. */
static int dgfem_mvci_split_face(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, int face,
                                 const dgfem_mvci_levels *levels) {
    dgfem_mvci_face old = mesh->faces[face];
    int n = old.count, start = 0, end, up, down;
    const int *loop = mesh->loops.data + old.loop;
    while (levels->sign[loop[start]] >= 0) start++; /* one below, */
    for (up = start; levels->sign[loop[up % n]] <= 0;) up++;
    while (levels->sign[loop[(up + n - 1) % n]] == 0) up--; /* the first behind the last below, */
    for (down = up; levels->sign[loop[down % n]] >= 0;) down++;
    end = down; /* and the next below */
    while (levels->sign[loop[(down + n - 1) % n]] == 0) down--;
    int zeros = 0;
    while (levels->sign[loop[(up + zeros) % n]] == 0) zeros++;
    if (!zeros || end == down) return face; /* a crossed edge without a node: nothing to divide by */
    int first = dgfem_mvci_nearest_level(levels, loop, n, up, zeros);
    int last = dgfem_mvci_nearest_level(levels, loop, n, down, end - down);
    s->buffer.count = 0;
    if (!dgfem_mvci_ints_room(s->hooks, &s->buffer, n + 4)) return DGFEM_NONE;
    for (int i = first; i <= last; i++) s->buffer.data[s->buffer.count++] = loop[i % n];
    int above = s->buffer.count;
    for (int i = last; i <= first + n; i++) s->buffer.data[s->buffer.count++] = loop[i % n];
    dgfem_vec3 normal = dgfem_mvci_loop_area(mesh->rest, loop, n);
    dgfem_vec3 part_above = dgfem_mvci_loop_area(mesh->rest, s->buffer.data, above);
    dgfem_vec3 part_below = dgfem_mvci_loop_area(mesh->rest, s->buffer.data + above, s->buffer.count - above);
    if (!(dgfem_mvci_dot(part_above, normal) > 0) || !(dgfem_mvci_dot(part_below, normal) > 0)) return face;
    if (!dgfem_mvci_set_loop(mesh, face, s->buffer.data, above)) return DGFEM_NONE;
    int part = dgfem_mvci_add_face(mesh, old.owner[0], old.owner[1], s->buffer.data + above, s->buffer.count - above,
                                   old.from, old.wall);
    if (part == DGFEM_NONE) return DGFEM_NONE;
    for (int side = 0; side < 2; side++)
        if (old.owner[side] != DGFEM_NONE && !dgfem_mvci_add_element_face(mesh, old.owner[side], part, side))
            return DGFEM_NONE;
    return part;
}

/* ---- elements ---- */

/* 1 above, -1 below. A face on the blade belongs to the side on which the element's inside is. */
static int dgfem_mvci_face_side(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, int entry) {
    int count;
    const int *loop = dgfem_mvci_face_loop(mesh, entry / 2, &count);
    for (int i = 0; i < count; i++)
        if (s->levels.sign[loop[i]]) return s->levels.sign[loop[i]];
    dgfem_vec3 area = dgfem_mvci_loop_area(dgfem_mvci_blade_space(s, mesh), loop, count);
    dgfem_real up = dgfem_mvci_dot(area, s->plane.normal);
    return (entry & 1 ? -up : up) > 0 ? -1 : 1;
}

/* s->list: the element's faces, s->group: their sides, s->root: connected ones of a side, s->sides: position in the
   list by directed edge. 0 when out of memory, -1 where edges do not match. */
static int dgfem_mvci_group_faces(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, int element) {
    int face_count;
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    s->list.count = s->group.count = s->root.count = 0;
    if (!dgfem_mvci_edges_reset(s->hooks, &s->sides, dgfem_mvci_element_corners(mesh, element))) return 0;
    for (int k = 0; k < face_count; k++)
        if (!dgfem_mvci_push(s->hooks, &s->list, faces[k]) || !dgfem_mvci_push(s->hooks, &s->root, k) ||
            !dgfem_mvci_push(s->hooks, &s->group, dgfem_mvci_face_side(s, mesh, faces[k])))
            return 0;
    for (int pass = 0; pass < 2; pass++)
        for (int k = 0; k < face_count; k++) {
            int count;
            const int *loop = dgfem_mvci_face_loop(mesh, faces[k] / 2, &count);
            for (int i = 0; i < count; i++) {
                int j = (i + 1) % count, a = loop[faces[k] & 1 ? j : i], b = loop[faces[k] & 1 ? i : j];
                if (!pass) {
                    dgfem_mvci_edges_at(&s->sides, a, b)->value = k;
                    continue;
                }
                int other = dgfem_mvci_edges_find(&s->sides, b, a);
                if (other == DGFEM_NONE) return -1;
                if (s->group.data[other] == s->group.data[k])
                    s->root.data[dgfem_mvci_root(s->root.data, other)] = dgfem_mvci_root(s->root.data, k);
            }
        }
    return 1;
}

/* s->bound: edges between the faces above and those below, as seen from the latter: start, end, face above, face below.
   Returns 0 when out of memory, -1 where two start at the same node. */
static int dgfem_mvci_find_bound(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh) {
    s->bound.count = 0;
    for (int k = 0; k < s->list.count; k++) {
        int count, entry = s->list.data[k];
        const int *loop = dgfem_mvci_face_loop(mesh, entry / 2, &count);
        if (s->group.data[k] > 0) continue;
        for (int i = 0; i < count; i++) {
            int j = (i + 1) % count, a = loop[entry & 1 ? j : i], b = loop[entry & 1 ? i : j];
            int other = dgfem_mvci_edges_find(&s->sides, b, a);
            if (s->group.data[other] < 0) continue;
            for (int l = 0; l < s->bound.count; l += 4)
                if (s->bound.data[l] == a) return -1;
            if (!dgfem_mvci_ints_room(s->hooks, &s->bound, 4)) return 0;
            int *edge = s->bound.data + s->bound.count;
            edge[0] = a, edge[1] = b, edge[2] = other, edge[3] = k;
            s->bound.count += 4;
        }
    }
    return 1;
}

/* Makes an element of each class of faces, the first of those above in place of the old one. s->group becomes the
   element of each class at its root. */
static int dgfem_mvci_make_parts(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, int element) {
    int from = mesh->elements[element].from, before = dgfem_mvci_element_before(s, element), used = 0;
    for (int pass = 0; pass < 2; pass++)
        for (int k = 0; k < s->list.count; k++) {
            int part = element;
            if (s->root.data[k] != k || (s->group.data[k] > 0) != !pass) continue;
            if (used++) part = dgfem_mvci_add_element(mesh, from);
            if (part == DGFEM_NONE) return 0;
            if (part != element && !dgfem_mvci_push(s->hooks, &s->parent, before)) return 0;
            s->group.data[k] = pass ? -2 - part : 2 + part; /* not taken for a side */
        }
    return 1;
}

static int dgfem_mvci_part_of(const dgfem_mvci_splitter *s, int k) {
    int value = s->group.data[dgfem_mvci_root(s->root.data, k)];
    return value < 0 ? -2 - value : value - 2;
}

/* Distributes the element's faces among its parts, and adds a face for each cycle of s->bound. Returns 0 when out of
   memory, -1 where the cycles are not good. */
static int dgfem_mvci_close_parts(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, int element) {
    mesh->elements[element].face_count = 0;
    for (int k = 0; k < s->list.count; k++) {
        int entry = s->list.data[k], part = dgfem_mvci_part_of(s, k);
        mesh->faces[entry / 2].owner[entry & 1] = part;
        if (!dgfem_mvci_add_element_face(mesh, part, entry / 2, entry & 1)) return 0;
    }
    for (int l = 0; l < s->bound.count; l += 4) {
        int at = l, above = dgfem_mvci_part_of(s, s->bound.data[l + 2]);
        int below = dgfem_mvci_part_of(s, s->bound.data[l + 3]);
        if (s->bound.data[l] == DGFEM_NONE) continue;
        s->buffer.count = 0;
        for (;;) { /* the cycle runs as the new face does, seen from outside of the part above */
            int next = s->bound.data[at + 1];
            if (dgfem_mvci_part_of(s, s->bound.data[at + 2]) != above ||
                dgfem_mvci_part_of(s, s->bound.data[at + 3]) != below)
                return -1;
            if (!dgfem_mvci_push(s->hooks, &s->buffer, s->bound.data[at])) return 0;
            s->bound.data[at] = DGFEM_NONE;
            if (next == s->buffer.data[0]) break;
            for (at = 0; at < s->bound.count && s->bound.data[at] != next;) at += 4;
            if (at >= s->bound.count) return -1;
        }
        if (s->buffer.count < 3) return -1;
        int face = dgfem_mvci_add_face(mesh, above, below, s->buffer.data, s->buffer.count, DGFEM_NONE, 0);
        if (face == DGFEM_NONE || !dgfem_mvci_add_element_face(mesh, above, face, 0) ||
            !dgfem_mvci_add_element_face(mesh, below, face, 1))
            return 0;
    }
    return 1;
}

/* Returns 0 when out of memory, -1 where the element cannot be split: the mesh is spoilt then. */
static int dgfem_mvci_split_element(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, int element) {
    int result = dgfem_mvci_group_faces(s, mesh, element);
    if (result > 0) result = dgfem_mvci_find_bound(s, mesh);
    if (result <= 0) return result;
    for (int k = 0; k < s->list.count; k++) s->root.data[k] = dgfem_mvci_root(s->root.data, k);
    if (!dgfem_mvci_make_parts(s, mesh, element)) return 0;
    return dgfem_mvci_close_parts(s, mesh, element);
}

/* ---- guards ---- */

/* Least height of an element's centroid above its triangles, relative to its diameter; not positive where it does not
   see one of them, or where round-off decides whether it does. */
static dgfem_real dgfem_mvci_element_height(const dgfem_mvci_mesh *mesh, int element) {
    int face_count, nodes[3];
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    dgfem_vec3 centre;
    dgfem_real diameter, least = 1, volume = dgfem_mvci_element_measure(mesh, element, &centre);
    if (!(volume > 0)) return 0;
    (void)dgfem_mvci_element_area(mesh, element, &diameter);
    for (int k = 0; k < face_count; k++)
        for (int t = 0; t < mesh->faces[faces[k] / 2].triangle_count; t++) {
            dgfem_mvci_triangle(mesh, faces[k] / 2, faces[k] & 1, t, nodes);
            dgfem_real area = dgfem_mvci_norm(dgfem_mvci_loop_area(mesh->rest, nodes, 3));
            dgfem_real height = dgfem_mvci_tetrahedron(mesh, nodes, centre) / (diameter * area);
            if (!(height >= least)) least = height > 0 ? height : 0;
        }
    return least > 64 * DGFEM_MVC_EPSILON * (1 + dgfem_mvci_norm(centre) / diameter) ? least : 0;
}

/* Whether an element's centroid sees all its triangles, from a height that is not just round-off. */
static int dgfem_mvci_element_is_good(const dgfem_mvci_mesh *mesh, int element) {
    return dgfem_mvci_element_height(mesh, element) > (DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-7));
}

/* Whether each directed edge of an element's triangles is there once, and once the other way, and the triangles are as
   many as on a sphere. Negative when out of memory. */
static int dgfem_mvci_element_is_closed(const dgfem_mvci_mesh *mesh, int element, dgfem_mvci_edges *edges) {
    int face_count, corner[3], triangles = 0, nodes = 0;
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    if (!dgfem_mvci_edges_reset(&mesh->hooks, edges, 4 * dgfem_mvci_element_corners(mesh, element))) return -1;
    for (int pass = 0; pass < 2; pass++)
        for (int k = 0; k < face_count; k++)
            for (int t = 0; t < mesh->faces[faces[k] / 2].triangle_count; t++) {
                dgfem_mvci_triangle(mesh, faces[k] / 2, faces[k] & 1, t, corner);
                triangles += !pass;
                for (int i = 0; i < 3; i++) {
                    int a = corner[i], b = corner[(i + 1) % 3];
                    if (pass && dgfem_mvci_edges_find(edges, b, a) == DGFEM_NONE) return 0;
                    if (pass) continue;
                    if (!dgfem_mvci_check_edge(edges, a, b)) return 0;
                    nodes += dgfem_mvci_check_edge(edges, a, a);
                }
            }
    return triangles == 2 * nodes - 4;
}

/* Triangulates what is new. DGFEM_ERROR_DEGENERATE where elements failed. */
static dgfem_status dgfem_mvci_settle_attempt(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh) {
    s->list.count = 0;
    dgfem_status status = dgfem_mvci_mesh_settle(mesh, &s->list);
    if (status == DGFEM_ERROR_MEMORY) return status;
    for (int i = 0; i < s->list.count; i++)
        for (int side = 0; side < 2; side++) {
            int owner = mesh->faces[s->list.data[i]].owner[side];
            if (owner != DGFEM_NONE && !dgfem_mvci_add_failed(s, owner)) return DGFEM_ERROR_MEMORY;
        }
    return s->failed.count ? DGFEM_ERROR_DEGENERATE : DGFEM_OK;
}

/* Divides the faces of the selected elements that have nodes on both sides. */
static dgfem_status dgfem_mvci_split_faces(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh) {
    for (int i = 0; i < s->selected.count; i++)
        for (int k = 0; k < mesh->elements[s->selected.data[i]].face_count; k++) {
            int face = mesh->element_faces.data[mesh->elements[s->selected.data[i]].face + k] / 2;
            if (dgfem_mvci_face_changes(mesh, face, &s->levels) != 2) continue;
            int part = dgfem_mvci_split_face(s, mesh, face, &s->levels);
            if (part == DGFEM_NONE) return DGFEM_ERROR_MEMORY;
            if (part != face) continue;
            if (!dgfem_mvci_add_failed(s, s->selected.data[i])) return DGFEM_ERROR_MEMORY;
            break;
        }
    return s->failed.count ? DGFEM_ERROR_DEGENERATE : DGFEM_OK;
}

/* Splits the selected elements. DGFEM_ERROR_DEGENERATE with s->failed where some cannot be: the mesh is spoilt then. */
static dgfem_status dgfem_mvci_split_selected(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh) {
    int corners = 0, first = mesh->element_count;
    s->parent.count = s->failed.count = 0;
    s->elements_split = s->nodes_added = 0;
    dgfem_mvci_snap_selected(s, mesh);
    if (!s->selected.count) return DGFEM_OK;
    for (int i = 0; i < s->selected.count; i++)
        if (!dgfem_mvci_divide_crossed(s, mesh, s->selected.data[i])) return DGFEM_ERROR_MEMORY;
    for (int i = 0; i < s->selected.count; i++) corners += dgfem_mvci_element_corners(mesh, s->selected.data[i]);
    if (!dgfem_mvci_edges_reset(s->hooks, &s->crossings, corners)) return DGFEM_ERROR_MEMORY;
    for (int i = 0; i < s->selected.count; i++)
        for (int k = 0; k < mesh->elements[s->selected.data[i]].face_count; k++) {
            int entry = mesh->element_faces.data[mesh->elements[s->selected.data[i]].face + k];
            if (!dgfem_mvci_cross_face(s, mesh, &s->levels, entry / 2)) return DGFEM_ERROR_MEMORY;
        }
    if (!dgfem_mvci_insert_nodes(s, mesh)) return DGFEM_ERROR_MEMORY;
    dgfem_status status = dgfem_mvci_split_faces(s, mesh);
    for (int i = 0; !status && i < s->selected.count; i++) {
        int result = dgfem_mvci_split_element(s, mesh, s->selected.data[i]);
        if (!result) return DGFEM_ERROR_MEMORY;
        if (result < 0 && !dgfem_mvci_add_failed(s, s->selected.data[i])) return DGFEM_ERROR_MEMORY;
    }
    if (!status && s->failed.count) status = DGFEM_ERROR_DEGENERATE;
    if (!status) status = dgfem_mvci_settle_attempt(s, mesh);
    if (status) return status;
    for (int i = 0; i < s->selected.count + mesh->element_count - first; i++) {
        int e = i < s->selected.count ? s->selected.data[i] : first + i - s->selected.count;
        if (!dgfem_mvci_element_is_good(mesh, e) && !dgfem_mvci_add_failed(s, e)) return DGFEM_ERROR_MEMORY;
    }
    s->elements_split = s->selected.count;
    return s->failed.count ? DGFEM_ERROR_DEGENERATE : DGFEM_OK;
}

/* Notes that an element that the attempt has changed has failed: where it is not closed, or not good; one that was not
   good before may lose half of what it had. 0 when out of memory. */
static int dgfem_mvci_guard_element(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, int element) {
    int before = dgfem_mvci_element_before(s, element), closed;
    if (!mesh->elements[element].changed) return 1; /* then it is what it was, to the last bit */
    closed = dgfem_mvci_element_is_closed(mesh, element, &s->sides);
    if (closed < 0) return 0;
    if (closed) {
        dgfem_real height;
        if (dgfem_mvci_element_is_good(mesh, element)) return 1;
        height = dgfem_mvci_element_height(mesh, element);
        if (height > 0 && !dgfem_mvci_element_is_good(s->before, before) &&
            height >= dgfem_mvci_element_height(s->before, before) / 2)
            return 1;
    }
    return dgfem_mvci_add_failed(s, element);
}

static dgfem_status dgfem_mvci_guard_elements(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh) {
    for (int e = 0; e < mesh->element_count; e++)
        if (mesh->elements[e].face_count && !dgfem_mvci_guard_element(s, mesh, e)) return DGFEM_ERROR_MEMORY;
    return s->failed.count ? DGFEM_ERROR_DEGENERATE : DGFEM_OK;
}

/* ---- learning from a failure ---- */

/* Brings a failed element to its next stage that asks more of it. Returns 0 where there is none. */
static int dgfem_mvci_raise_element(dgfem_mvci_splitter *s, int element, int least) {
    static const dgfem_real part[DGFEM_MVCI_WHOLE] = {1, DGFEM_R(0.2), DGFEM_R(0.02), DGFEM_R(0.005), 0};
    int face_count, stage = s->stage[element], lowered = 0;
    const int *faces = dgfem_mvci_element_faces(s->before, element, &face_count);
    if (stage == DGFEM_MVCI_SEALED) return 0;
    do {
        stage++;
        for (int k = 0; k < face_count && stage < DGFEM_MVCI_WHOLE; k++) {
            int count;
            const int *loop = dgfem_mvci_face_loop(s->before, faces[k] / 2, &count);
            dgfem_real limit = dgfem_mvci_max(part[stage] * s->snap, (dgfem_real)DGFEM_MVC_TIE);
            for (int j = 0; j < count; j++) {
                if (s->tolerance[loop[j]] <= limit) continue;
                s->tolerance[loop[j]] = limit;
                lowered = 1;
            }
        }
    } while (stage < least || (stage < DGFEM_MVCI_WHOLE && !lowered)); /* what changes nothing would fail again */
    s->stage[element] = (char)stage;
    return 1;
}

/* Elements that share an edge with a sealed one come to the stage, at least. 0 when out of memory. */
static int dgfem_mvci_seal_edges(dgfem_mvci_splitter *s, char stage) {
    const dgfem_mvci_mesh *mesh = s->before;
    int corners = 0;
    for (int e = 0; e < mesh->element_count; e++)
        if (s->stage[e] == DGFEM_MVCI_SEALED) corners += dgfem_mvci_element_corners(mesh, e);
    if (!corners) return 1;
    if (!dgfem_mvci_edges_reset(s->hooks, &s->sealed, corners)) return 0;
    for (int pass = 0; pass < 2; pass++)
        for (int f = 0; f < mesh->face_count; f++) {
            int count, found = 0, sealed = 0;
            const int *loop = dgfem_mvci_face_loop(mesh, f, &count), *owner = mesh->faces[f].owner;
            for (int side = 0; side < 2; side++)
                sealed |= owner[side] != DGFEM_NONE && s->stage[owner[side]] == DGFEM_MVCI_SEALED;
            for (int i = 0; i < count; i++) {
                int a = loop[i], b = loop[(i + 1) % count];
                if (!pass && sealed) dgfem_mvci_edges_between(&s->sealed, a, b)->value = 1;
                if (pass && !found) found = dgfem_mvci_edges_find_between(&s->sealed, a, b) != DGFEM_NONE;
            }
            for (int side = 0; side < 2 && found; side++)
                if (owner[side] != DGFEM_NONE && s->stage[owner[side]] < stage) s->stage[owner[side]] = stage;
        }
    return 1;
}

/* After a failed attempt. Returns 0 where nothing is left to be asked, which sealed elements rule out, for nothing
   changes them; negative when out of memory. So the stages rise with each attempt, and attempts come to an end; where
   they go on for long, stages are left out, and then what is sealed grows by a ring of elements each time. */
static int dgfem_mvci_splitter_learn(dgfem_mvci_splitter *s, int attempt) {
    int raised = 0;
    for (int i = 0; i < s->failed.count; i++)
        raised |= dgfem_mvci_raise_element(s, s->failed.data[i], attempt < 16 ? 0 : DGFEM_MVCI_WHOLE);
    if (attempt >= 32 && !dgfem_mvci_seal_edges(s, DGFEM_MVCI_SEALED)) return -1;
    return dgfem_mvci_seal_edges(s, DGFEM_MVCI_WHOLE) ? raised : -1;
}
