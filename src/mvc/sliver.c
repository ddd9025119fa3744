#pragma once
#include "crack.c"
/* Removing flat elements and needles.

   A flat element is pressed into a plane: nodes that meet there become one, its edges are cut where they cross, and the
   cells of the plane become the faces between what was above it and what was below:

        above    above                above
       /-------------\
      <  flat element >   ->    ------x-------x-----
       \-----x-------/
         below  below             below   below

   A needle's short edges vanish, and with them the needle; flat neighbours that come of this follow. Nodes of the
   body's boundary move within the boundary only. Each removal is tried on a copy, and dropped where the elements around
   are not good afterwards, or where volume has passed the boundary. */

typedef struct dgfem_mvci_sliver {
    const dgfem_hooks *hooks;
    dgfem_mvci_mesh *mesh; /* the copy */
    dgfem_vec3 origin, u, v, n;
    dgfem_real diameter;
    dgfem_mvci_ints nodes;    /* of the element */
    dgfem_mvci_ints near;     /* faces with such nodes */
    dgfem_mvci_ints affected; /* elements of those */
    dgfem_mvci_ints queue;    /* elements to be removed */
    dgfem_mvci_ints root;     /* [nodes] welded to */
    dgfem_mvci_ints rank;     /* [nodes] independent directions in which a node may not move */
    dgfem_mvci_ints ends;     /* pairs of nodes: edges of the element */
    dgfem_mvci_ints cell, mark, buffer, list;
    dgfem_mvci_edges edges;
    dgfem_mvci_polygon polygon;
} dgfem_mvci_sliver;

static void dgfem_mvci_sliver_free(dgfem_mvci_sliver *s) {
    dgfem_mvci_free(s->hooks, s->nodes.data);
    dgfem_mvci_free(s->hooks, s->near.data);
    dgfem_mvci_free(s->hooks, s->affected.data);
    dgfem_mvci_free(s->hooks, s->queue.data);
    dgfem_mvci_free(s->hooks, s->root.data);
    dgfem_mvci_free(s->hooks, s->rank.data);
    dgfem_mvci_free(s->hooks, s->ends.data);
    dgfem_mvci_free(s->hooks, s->cell.data);
    dgfem_mvci_free(s->hooks, s->mark.data);
    dgfem_mvci_free(s->hooks, s->buffer.data);
    dgfem_mvci_free(s->hooks, s->list.data);
    dgfem_mvci_free(s->hooks, s->edges.slots);
    dgfem_mvci_polygon_free(s->hooks, &s->polygon);
}

/* Results of the steps below. */
enum { DGFEM_MVCI_NO_MEMORY = -1, DGFEM_MVCI_REFUSED = 0, DGFEM_MVCI_DONE = 1 };

static int dgfem_mvci_push_once(const dgfem_hooks *hooks, dgfem_mvci_ints *ints, int value) {
    for (int i = 0; i < ints->count; i++)
        if (ints->data[i] == value) return 1;
    return dgfem_mvci_push(hooks, ints, value);
}

static int dgfem_mvci_position_in(const dgfem_mvci_ints *ints, int value) {
    for (int i = 0; i < ints->count; i++)
        if (ints->data[i] == value) return i;
    return DGFEM_NONE;
}

/* ---- the neighbourhood ---- */

static int dgfem_mvci_sliver_nodes(dgfem_mvci_sliver *s, int element) {
    int face_count;
    const int *faces = dgfem_mvci_element_faces(s->mesh, element, &face_count);
    s->nodes.count = 0;
    for (int k = 0; k < face_count; k++) {
        int count;
        const int *loop = dgfem_mvci_face_loop(s->mesh, faces[k] / 2, &count);
        for (int i = 0; i < count; i++)
            if (!dgfem_mvci_push_once(s->hooks, &s->nodes, loop[i])) return 0;
    }
    return 1;
}

/* Faces that have a node of s->nodes; s->affected gains their elements. */
static int dgfem_mvci_sliver_near(dgfem_mvci_sliver *s) {
    const dgfem_mvci_mesh *mesh = s->mesh;
    if (!dgfem_mvci_fill(s->hooks, &s->mark, mesh->node_count, 0)) return 0;
    for (int i = 0; i < s->nodes.count; i++) s->mark.data[s->nodes.data[i]] = 1;
    s->near.count = 0;
    for (int f = 0; f < mesh->face_count; f++) {
        int found = 0;
        const dgfem_mvci_face *face = &mesh->faces[f];
        if (face->owner[0] == DGFEM_NONE) continue;
        for (int i = 0; i < face->count && !found; i++) found = s->mark.data[mesh->loops.data[face->loop + i]];
        if (!found) continue;
        if (!dgfem_mvci_push(s->hooks, &s->near, f)) return 0;
        for (int side = 0; side < 2; side++)
            if (face->owner[side] != DGFEM_NONE && !dgfem_mvci_push_once(s->hooks, &s->affected, face->owner[side]))
                return 0;
    }
    return 1;
}

/* Volume and its first moment of the affected elements. */
static dgfem_real dgfem_mvci_affected_volume(const dgfem_mvci_sliver *s, const dgfem_mvci_mesh *mesh,
                                             dgfem_vec3 *moment) {
    dgfem_real sum = 0;
    *moment = dgfem_mvci_vec3(0, 0, 0);
    for (int i = 0; i < s->affected.count; i++) {
        dgfem_vec3 centre;
        if (!mesh->elements[s->affected.data[i]].face_count) continue;
        dgfem_real volume = dgfem_mvci_element_measure(mesh, s->affected.data[i], &centre);
        sum += volume;
        *moment = dgfem_mvci_axpy(*moment, volume, dgfem_mvci_sub(centre, s->origin));
    }
    return sum;
}

/* The directions in which the boundary does not let a node move: at most three, orthonormal. */
static int dgfem_mvci_node_bounds(const dgfem_mvci_sliver *s, int node, dgfem_vec3 bounds[3]) {
    const dgfem_mvci_mesh *mesh = s->mesh;
    int rank = 0;
    for (int k = 0; k < s->near.count && rank < 3; k++) {
        const dgfem_mvci_face *face = &mesh->faces[s->near.data[k]];
        const int *loop = mesh->loops.data + face->loop;
        int found = 0;
        if (face->owner[0] == DGFEM_NONE || face->owner[1] != DGFEM_NONE) continue;
        for (int i = 0; i < face->count && !found; i++) found = loop[i] == node;
        if (!found) continue;
        dgfem_vec3 normal = dgfem_mvci_unit(dgfem_mvci_loop_area(mesh->rest, loop, face->count));
        for (int i = 0; i < rank; i++) normal = dgfem_mvci_axpy(normal, -dgfem_mvci_dot(normal, bounds[i]), bounds[i]);
        if (dgfem_mvci_norm(normal) > (DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-3) : DGFEM_R(1e-7)))
            bounds[rank++] = dgfem_mvci_unit(normal);
    }
    return rank;
}

/* Mean, and principal axes and extents, of the element's nodes. */
static void dgfem_mvci_sliver_axes(dgfem_mvci_sliver *s, dgfem_real extent[3]) {
    dgfem_mat3 a, axes;
    dgfem_real values[3];
    dgfem_vec3 axis[3], mean = dgfem_mvci_vec3(0, 0, 0);
    memset(&a, 0, sizeof a);
    for (int i = 0; i < s->nodes.count; i++)
        mean = dgfem_mvci_axpy(mean, 1 / (dgfem_real)s->nodes.count, s->mesh->rest[s->nodes.data[i]]);
    for (int i = 0; i < s->nodes.count; i++) {
        dgfem_vec3 d = dgfem_mvci_sub(s->mesh->rest[s->nodes.data[i]], mean);
        dgfem_mvci_add_outer(&a, 1, d, d);
    }
    dgfem_eigen_symmetric(a, values, &axes);
    for (int k = 0; k < 3; k++) {
        dgfem_real low = 0, high = 0;
        axis[k] = dgfem_mvci_vec3(axes.m[0][k], axes.m[1][k], axes.m[2][k]);
        for (int i = 0; i < s->nodes.count; i++) {
            dgfem_real x = dgfem_mvci_dot(axis[k], dgfem_mvci_sub(s->mesh->rest[s->nodes.data[i]], mean));
            if (x < low) low = x;
            if (x > high) high = x;
        }
        extent[k] = high - low;
    }
    s->origin = mean;
    s->n = axis[0], s->u = axis[1], s->v = dgfem_mvci_cross(s->n, s->u);
    s->diameter = extent[2];
}

static void dgfem_mvci_sliver_place(const dgfem_mvci_sliver *s, int node, double out[2]) {
    dgfem_vec3 d = dgfem_mvci_sub(s->mesh->rest[node], s->origin);
    out[0] = (double)dgfem_mvci_dot(d, s->u);
    out[1] = (double)dgfem_mvci_dot(d, s->v);
}

/* Area of a face projected along s->n, signed as seen from outside of the element. */
static dgfem_real dgfem_mvci_projected_area(const dgfem_mvci_sliver *s, int entry) {
    int count;
    const int *loop = dgfem_mvci_face_loop(s->mesh, entry / 2, &count);
    dgfem_real area = dgfem_mvci_dot(dgfem_mvci_loop_area(s->mesh->rest, loop, count), s->n) / 2;
    return entry & 1 ? -area : area;
}

/* ---- moving nodes ---- */

/* The mean gradient of the deformation around a node, from all nodes of the faces near it. */
static dgfem_mat3 dgfem_mvci_local_gradient(const dgfem_mvci_sliver *s, int node) {
    const dgfem_mvci_mesh *mesh = s->mesh;
    dgfem_mat3 a, b, inverse;
    memset(&a, 0, sizeof a);
    memset(&b, 0, sizeof b);
    for (int k = 0; k < s->near.count; k++) {
        const dgfem_mvci_face *face = &mesh->faces[s->near.data[k]];
        for (int i = 0; i < face->count && face->owner[0] != DGFEM_NONE; i++) {
            int other = mesh->loops.data[face->loop + i];
            dgfem_vec3 d = dgfem_mvci_sub(mesh->rest[other], mesh->rest[node]);
            dgfem_mvci_add_outer(&a, 1, d, d);
            dgfem_mvci_add_outer(&b, 1, dgfem_mvci_sub(mesh->position[other], mesh->position[node]), d);
        }
    }
    if (!dgfem_mvci_invert(&a, &inverse)) return dgfem_mvci_identity();
    return dgfem_mvci_multiply3(&b, &inverse);
}

static void dgfem_mvci_move_node(dgfem_mvci_sliver *s, int node, dgfem_vec3 by) {
    dgfem_mat3 gradient = dgfem_mvci_local_gradient(s, node);
    s->mesh->rest[node] = dgfem_mvci_add(s->mesh->rest[node], by);
    s->mesh->position[node] = dgfem_mvci_add(s->mesh->position[node], dgfem_mvci_multiply(&gradient, by));
}

/* Moves a node into the plane, as far as the boundary lets it. */
static void dgfem_mvci_press_node(dgfem_mvci_sliver *s, int node) {
    dgfem_vec3 bounds[3], along = s->n;
    dgfem_real distance = dgfem_mvci_dot(s->n, dgfem_mvci_sub(s->mesh->rest[node], s->origin));
    int rank = dgfem_mvci_node_bounds(s, node, bounds);
    for (int i = 0; i < rank; i++) along = dgfem_mvci_axpy(along, -dgfem_mvci_dot(along, bounds[i]), bounds[i]);
    dgfem_real part = dgfem_mvci_dot(along, s->n);
    if (rank == 3 || part < DGFEM_R(0.1) || distance == 0) return;
    dgfem_mvci_move_node(s, node, dgfem_mvci_scale(-distance / part, along));
}

/* Where faces of the element are on the boundary of the body the plane is theirs. 0 where they do not agree. */
static int dgfem_mvci_sliver_plane(dgfem_mvci_sliver *s, int element) {
    int face_count, found = 0;
    const int *faces = dgfem_mvci_element_faces(s->mesh, element, &face_count);
    dgfem_real least = s->diameter * s->diameter / 1000;
    for (int k = 0; k < face_count; k++) {
        int count, other = s->mesh->faces[faces[k] / 2].owner[!(faces[k] & 1)];
        const int *loop = dgfem_mvci_face_loop(s->mesh, faces[k] / 2, &count);
        dgfem_real area = dgfem_mvci_projected_area(s, faces[k]);
        if (other != DGFEM_NONE || dgfem_mvci_abs(area) < least) continue;
        dgfem_vec3 normal = dgfem_mvci_unit(dgfem_mvci_loop_area(s->mesh->rest, loop, count));
        if (found && dgfem_mvci_norm(dgfem_mvci_cross(normal, s->n)) > DGFEM_R(1e-5)) return 0;
        if (found && area < 0) return 0; /* s->n points out of it; -n would of a second one on the other side */
        if (found) continue;
        found = 1;
        s->n = normal;
        s->origin = s->mesh->rest[loop[0]];
        s->u = dgfem_mvci_unit(dgfem_mvci_axpy(s->u, -dgfem_mvci_dot(s->u, s->n), s->n));
        s->v = dgfem_mvci_cross(s->n, s->u);
    }
    return 1;
}

/* ---- welding ---- */

/* Removes what is double in a loop or runs back. Returns what is left, -1 where the loop would touch itself. */
static int dgfem_mvci_clean_loop(int *loop, int count) {
    for (int i = 0; i < count && count > 2;) {
        int previous = loop[(i + count - 1) % count], next = loop[(i + 1) % count];
        if (loop[i] != next && previous != next) {
            i++;
            continue;
        }
        for (int j = i; j + 1 < count; j++) loop[j] = loop[j + 1];
        count--;
        i = 0;
    }
    for (int i = 0; i < count && count > 2; i++)
        for (int j = i + 1; j < count; j++)
            if (loop[i] == loop[j]) return -1;
    return count;
}

/* Gives a face the loop in s->buffer. */
static int dgfem_mvci_put_loop(dgfem_mvci_sliver *s, int face) {
    int left = dgfem_mvci_clean_loop(s->buffer.data, s->buffer.count);
    if (left < 0) return DGFEM_MVCI_REFUSED;
    if (left < 3) dgfem_mvci_remove_face(s->mesh, face);
    else if (!dgfem_mvci_set_loop(s->mesh, face, s->buffer.data, left)) return DGFEM_MVCI_NO_MEMORY;
    return DGFEM_MVCI_DONE;
}

/* Welds s->nodes as s->root says. */
static int dgfem_mvci_weld(dgfem_mvci_sliver *s) {
    dgfem_mvci_mesh *mesh = s->mesh;
    for (int i = 0; i < s->nodes.count; i++) s->root.data[i] = dgfem_mvci_root(s->root.data, i);
    for (int k = 0; k < s->near.count; k++) {
        int f = s->near.data[k], result;
        if (mesh->faces[f].owner[0] == DGFEM_NONE) continue;
        s->buffer.count = 0;
        if (dgfem_mvci_append(s->hooks, &s->buffer, mesh->loops.data + mesh->faces[f].loop, mesh->faces[f].count) ==
            DGFEM_NONE)
            return DGFEM_MVCI_NO_MEMORY;
        for (int i = 0; i < s->buffer.count; i++) {
            int n = dgfem_mvci_position_in(&s->nodes, s->buffer.data[i]);
            if (n != DGFEM_NONE) s->buffer.data[i] = s->nodes.data[s->root.data[n]];
        }
        result = dgfem_mvci_put_loop(s, f);
        if (result <= 0) return result;
    }
    return DGFEM_MVCI_DONE;
}

/* Joins two nodes of the element; that which the boundary binds more stays. 0 where neither may move. */
static int dgfem_mvci_weld_pair(dgfem_mvci_sliver *s, int i, int j) {
    i = dgfem_mvci_root(s->root.data, i), j = dgfem_mvci_root(s->root.data, j);
    if (i == j) return 1;
    if (s->rank.data[i] == 3 && s->rank.data[j] == 3) return 0;
    if (s->rank.data[i] >= s->rank.data[j]) s->root.data[j] = i;
    else s->root.data[i] = j;
    return 1;
}

/* s->root: nothing welded; s->rank: of all nodes. */
static int dgfem_mvci_weld_begin(dgfem_mvci_sliver *s) {
    dgfem_vec3 bounds[3];
    s->root.count = s->rank.count = 0;
    for (int i = 0; i < s->nodes.count; i++)
        if (!dgfem_mvci_push(s->hooks, &s->root, i) ||
            !dgfem_mvci_push(s->hooks, &s->rank, dgfem_mvci_node_bounds(s, s->nodes.data[i], bounds)))
            return 0;
    return 1;
}

/* ---- the arrangement of edges in the plane ---- */

/* s->ends: all edges of the element, once each. */
static int dgfem_mvci_sliver_edges(dgfem_mvci_sliver *s, int element) {
    int face_count;
    const int *faces = dgfem_mvci_element_faces(s->mesh, element, &face_count);
    s->ends.count = 0;
    if (!dgfem_mvci_edges_reset(s->hooks, &s->edges, dgfem_mvci_element_corners(s->mesh, element))) return 0;
    for (int k = 0; k < face_count; k++) {
        int count;
        const int *loop = dgfem_mvci_face_loop(s->mesh, faces[k] / 2, &count);
        for (int i = 0; i < count; i++) {
            dgfem_mvci_edge *edge = dgfem_mvci_edges_between(&s->edges, loop[i], loop[(i + 1) % count]);
            if (edge->value != DGFEM_NONE) continue;
            edge->value = 1;
            if (!dgfem_mvci_push(s->hooks, &s->ends, edge->a) || !dgfem_mvci_push(s->hooks, &s->ends, edge->b))
                return 0;
        }
    }
    return 1;
}

/* Puts a node into the edge from a to b of all faces that have it. A triangle of the three vanishes. */
static int dgfem_mvci_insert_into_edge(dgfem_mvci_sliver *s, int a, int b, int node) {
    dgfem_mvci_mesh *mesh = s->mesh;
    for (int k = 0; k < s->near.count; k++) {
        int f = s->near.data[k], count = mesh->faces[f].count, at = DGFEM_NONE, result;
        const int *loop = mesh->loops.data + mesh->faces[f].loop;
        if (mesh->faces[f].owner[0] == DGFEM_NONE) continue;
        for (int i = 0; i < count; i++) {
            int j = (i + 1) % count;
            if ((loop[i] == a && loop[j] == b) || (loop[i] == b && loop[j] == a)) at = i;
        }
        if (at == DGFEM_NONE) continue;
        s->buffer.count = 0;
        if (!dgfem_mvci_ints_room(s->hooks, &s->buffer, count + 1)) return DGFEM_MVCI_NO_MEMORY;
        for (int i = 0; i < count; i++) {
            s->buffer.data[s->buffer.count++] = loop[i];
            if (i == at) s->buffer.data[s->buffer.count++] = node;
        }
        result = dgfem_mvci_put_loop(s, f);
        if (result <= 0) return result;
    }
    return DGFEM_MVCI_DONE;
}

/* Whether an edge lies on the boundary of the body. */
static int dgfem_mvci_on_boundary(const dgfem_mvci_sliver *s, int a, int b) {
    const dgfem_mvci_mesh *mesh = s->mesh;
    for (int k = 0; k < s->near.count; k++) {
        const dgfem_mvci_face *face = &mesh->faces[s->near.data[k]];
        if (face->owner[0] == DGFEM_NONE || face->owner[1] != DGFEM_NONE) continue;
        for (int i = 0; i < face->count; i++) {
            int c = mesh->loops.data[face->loop + i], d = mesh->loops.data[face->loop + (i + 1) % face->count];
            if ((c == a && d == b) || (c == b && d == a)) return 1;
        }
    }
    return 0;
}

/* One node of the element on one of its edges, in projection, goes into that edge. *found tells. */
static int dgfem_mvci_settle_touching(dgfem_mvci_sliver *s, int *found) {
    double eps = 0.01 * (double)s->diameter;
    for (int l = 0; l < s->ends.count; l += 2) {
        double a[2], b[2], p[2];
        int first = s->ends.data[l], second = s->ends.data[l + 1];
        dgfem_mvci_sliver_place(s, first, a);
        dgfem_mvci_sliver_place(s, second, b);
        double square = dgfem_mvci_square(a, b), length = sqrt(square);
        for (int i = 0; i < s->nodes.count; i++) {
            int node = s->nodes.data[i];
            if (node == first || node == second) continue;
            dgfem_mvci_sliver_place(s, node, p);
            double t = ((p[0] - a[0]) * (b[0] - a[0]) + (p[1] - a[1]) * (b[1] - a[1])) / square;
            if (t * length <= eps || (1 - t) * length <= eps) continue;
            if (fabs(dgfem_mvci_turn(a, b, p)) > eps * length) continue;
            *found = 1;
            return dgfem_mvci_insert_into_edge(s, first, second, node);
        }
    }
    return DGFEM_MVCI_DONE;
}

/* A node where two edges cross in projection: half way between them, or on that which is on the boundary. */
static int dgfem_mvci_add_crossing(dgfem_mvci_sliver *s, const int ends[4], const double t[2]) {
    dgfem_real weights[4], share = DGFEM_R(0.5);
    int bound[2];
    for (int k = 0; k < 2; k++) bound[k] = dgfem_mvci_on_boundary(s, ends[2 * k], ends[2 * k + 1]);
    if (bound[0] != bound[1]) share = bound[0] ? 1 : 0;
    for (int k = 0; k < 2; k++) {
        dgfem_real part = k ? 1 - share : share;
        weights[2 * k] = (1 - (dgfem_real)t[k]) * part;
        weights[2 * k + 1] = (dgfem_real)t[k] * part;
    }
    int first = share == 0 ? 2 : 0, count = share == 0 || share == 1 ? 2 : 4;
    int node = dgfem_mvci_add_node(s->mesh, ends + first, weights + first, count);
    if (node == DGFEM_NONE || !dgfem_mvci_push(s->hooks, &s->nodes, node)) return DGFEM_MVCI_NO_MEMORY;
    int result = dgfem_mvci_insert_into_edge(s, ends[0], ends[1], node);
    return result > 0 ? dgfem_mvci_insert_into_edge(s, ends[2], ends[3], node) : result;
}

/* The first crossing of two edges becomes a node. *found tells. */
static int dgfem_mvci_settle_crossing(dgfem_mvci_sliver *s, int *found) {
    for (int l = 0; l < s->ends.count; l += 2)
        for (int m = l + 2; m < s->ends.count; m += 2) {
            double a[2], b[2], c[2], d[2], t[2];
            int ends[4];
            ends[0] = s->ends.data[l], ends[1] = s->ends.data[l + 1];
            ends[2] = s->ends.data[m], ends[3] = s->ends.data[m + 1];
            if (ends[0] == ends[2] || ends[0] == ends[3] || ends[1] == ends[2] || ends[1] == ends[3]) continue;
            dgfem_mvci_sliver_place(s, ends[0], a);
            dgfem_mvci_sliver_place(s, ends[1], b);
            dgfem_mvci_sliver_place(s, ends[2], c);
            dgfem_mvci_sliver_place(s, ends[3], d);
            double ta = dgfem_mvci_turn(c, d, a), tb = dgfem_mvci_turn(c, d, b);
            double tc = dgfem_mvci_turn(a, b, c), td = dgfem_mvci_turn(a, b, d);
            if (!((ta > 0 && tb < 0) || (ta < 0 && tb > 0)) || !((tc > 0 && td < 0) || (tc < 0 && td > 0))) continue;
            t[0] = ta / (ta - tb), t[1] = tc / (tc - td);
            *found = 1;
            return dgfem_mvci_add_crossing(s, ends, t);
        }
    return DGFEM_MVCI_DONE;
}

/* Makes the edges of the element meet at nodes only. */
static int dgfem_mvci_arrange(dgfem_mvci_sliver *s, int element) {
    for (int round = 0; round < 200; round++) {
        int found = 0, result;
        if (!dgfem_mvci_sliver_edges(s, element)) return DGFEM_MVCI_NO_MEMORY;
        result = dgfem_mvci_settle_touching(s, &found);
        if (result > 0 && !found) result = dgfem_mvci_settle_crossing(s, &found);
        if (result <= 0 || !found) return result;
    }
    return DGFEM_MVCI_REFUSED;
}

/* ---- cells ---- */

/* Where the edge that follows the one from a to b around the cell on its left ends: the next clockwise from a, at b. */
static int dgfem_mvci_next_around(const dgfem_mvci_sliver *s, int a, int b) {
    double p[2], q[2], best_angle = 0;
    int best = DGFEM_NONE;
    dgfem_mvci_sliver_place(s, b, q);
    dgfem_mvci_sliver_place(s, a, p);
    double back = atan2(p[1] - q[1], p[0] - q[0]);
    for (int l = 0; l < s->ends.count; l++) {
        if (s->ends.data[l] != b) continue;
        int c = s->ends.data[l ^ 1];
        dgfem_mvci_sliver_place(s, c, p);
        double angle = back - atan2(p[1] - q[1], p[0] - q[0]);
        while (angle <= 1e-12) angle += 6.283185307179586;
        if (c == a) angle = 6.283185307179586;
        if (best != DGFEM_NONE && angle >= best_angle) continue;
        best = c, best_angle = angle;
    }
    return best;
}

/* A point inside of the cell's polygon: the centroid of the largest of its triangles. */
static int dgfem_mvci_cell_point(dgfem_mvci_sliver *s, double out[2]) {
    int n = s->cell.count, best = 0;
    double largest = 0;
    if (!dgfem_mvci_polygon_room(s->hooks, &s->polygon, n)) return DGFEM_MVCI_NO_MEMORY;
    for (int i = 0; i < n; i++) {
        s->polygon.node[i] = i;
        dgfem_mvci_sliver_place(s, s->cell.data[i], s->polygon.point[i]);
    }
    s->polygon.count = n;
    s->polygon.flat = 0;
    int count = dgfem_mvci_polygon_triangulate(&s->polygon);
    const int *t = s->polygon.triangles;
    for (int i = 0; i < count; i++) {
        double area =
            dgfem_mvci_turn(s->polygon.point[t[3 * i]], s->polygon.point[t[3 * i + 1]], s->polygon.point[t[3 * i + 2]]);
        if (area > largest) largest = area, best = i;
    }
    for (int j = 0; j < 2; j++)
        out[j] = count ? (s->polygon.point[t[3 * best]][j] + s->polygon.point[t[3 * best + 1]][j] +
                          s->polygon.point[t[3 * best + 2]][j]) /
                             3
                       : 0;
    return count ? DGFEM_MVCI_DONE : DGFEM_MVCI_REFUSED;
}

/* The element beyond the only face on one side (1 above, -1 below) that covers a point. *faces counts such faces. */
static int dgfem_mvci_beyond(const dgfem_mvci_sliver *s, int element, int side, const double p[2], int *faces) {
    int face_count, beyond = DGFEM_NONE;
    const int *list = dgfem_mvci_element_faces(s->mesh, element, &face_count);
    *faces = 0;
    for (int k = 0; k < face_count; k++) {
        int count, inside = 0;
        const int *loop = dgfem_mvci_face_loop(s->mesh, list[k] / 2, &count);
        if (dgfem_mvci_projected_area(s, list[k]) * (dgfem_real)side <= 0) continue;
        for (int i = 0; i < count; i++) {
            double a[2], b[2];
            dgfem_mvci_sliver_place(s, loop[i], a);
            dgfem_mvci_sliver_place(s, loop[(i + 1) % count], b);
            if ((a[1] > p[1]) == (b[1] > p[1])) continue;
            if (p[0] < a[0] + (p[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])) inside = !inside;
        }
        if (!inside) continue;
        beyond = s->mesh->faces[list[k] / 2].owner[!(list[k] & 1)];
        ++*faces;
    }
    return beyond;
}

/* The cell in s->cell becomes a face between what is above and below. */
static int dgfem_mvci_close_cell(dgfem_mvci_sliver *s, int element) {
    double p[2];
    int faces_above, faces_below, result = dgfem_mvci_cell_point(s, p);
    if (result <= 0) return result;
    int above = dgfem_mvci_beyond(s, element, 1, p, &faces_above);
    int below = dgfem_mvci_beyond(s, element, -1, p, &faces_below);
    if (faces_above != 1 || faces_below != 1) return DGFEM_MVCI_REFUSED;
    if (above == below) return above == DGFEM_NONE ? DGFEM_MVCI_REFUSED : DGFEM_MVCI_DONE;
    if (below == DGFEM_NONE) {
        dgfem_mvci_reverse(s->cell.data, s->cell.count);
        below = above, above = DGFEM_NONE;
    }
    int from = DGFEM_NONE, wall = 0;
    for (int k = 0; above == DGFEM_NONE && k < s->mesh->elements[element].face_count; k++) {
        const dgfem_mvci_face *face =
            &s->mesh->faces[s->mesh->element_faces.data[s->mesh->elements[element].face + k] / 2];
        if (face->owner[1] == DGFEM_NONE) from = face->from, wall = face->wall;
    }
    /* kept aside: the element's own faces are removed when all cells are known */
    int face = dgfem_mvci_add_face(s->mesh, below, above, s->cell.data, s->cell.count, from, wall);
    if (face == DGFEM_NONE || !dgfem_mvci_push(s->hooks, &s->list, face) || !dgfem_mvci_push(s->hooks, &s->near, face))
        return DGFEM_MVCI_NO_MEMORY;
    return DGFEM_MVCI_DONE;
}

/* Follows every edge both ways around the cells of the plane; those of positive area become faces. */
static int dgfem_mvci_close_cells(dgfem_mvci_sliver *s, int element) {
    s->list.count = 0;
    if (!dgfem_mvci_sliver_edges(s, element) || !dgfem_mvci_edges_reset(s->hooks, &s->edges, s->ends.count))
        return DGFEM_MVCI_NO_MEMORY;
    for (int l = 0; l < s->ends.count; l++) {
        int a = s->ends.data[l], b = s->ends.data[l ^ 1], start = a, second = b;
        if (dgfem_mvci_edges_find(&s->edges, a, b) != DGFEM_NONE) continue;
        s->cell.count = 0;
        do {
            int next = dgfem_mvci_next_around(s, a, b);
            dgfem_mvci_edges_at(&s->edges, a, b)->value = 1;
            if (!dgfem_mvci_push(s->hooks, &s->cell, a)) return DGFEM_MVCI_NO_MEMORY;
            if (next == DGFEM_NONE || s->cell.count > s->ends.count) return DGFEM_MVCI_REFUSED;
            a = b, b = next;
        } while (a != start || b != second);
        dgfem_vec3 area = dgfem_mvci_loop_area(s->mesh->rest, s->cell.data, s->cell.count);
        if (s->cell.count < 3 || !(dgfem_mvci_dot(area, s->n) > 0)) continue;
        int result = dgfem_mvci_close_cell(s, element);
        if (result <= 0) return result;
    }
    return s->list.count ? DGFEM_MVCI_DONE : DGFEM_MVCI_REFUSED;
}

/* ---- one removal ---- */

/* Presses an element into its plane. */
static int dgfem_mvci_flatten(dgfem_mvci_sliver *s, int element) {
    dgfem_mvci_mesh *mesh = s->mesh;
    dgfem_real extent[3], eps;
    int result;
    if (!dgfem_mvci_sliver_nodes(s, element)) return DGFEM_MVCI_NO_MEMORY;
    dgfem_mvci_sliver_axes(s, extent);
    if (!dgfem_mvci_sliver_near(s)) return DGFEM_MVCI_NO_MEMORY;
    if (!dgfem_mvci_sliver_plane(s, element)) return DGFEM_MVCI_REFUSED;
    for (int i = 0; i < s->nodes.count; i++) dgfem_mvci_press_node(s, s->nodes.data[i]);

    eps = s->diameter / 50;
    if (!dgfem_mvci_weld_begin(s)) return DGFEM_MVCI_NO_MEMORY;
    for (int i = 0; i < s->nodes.count; i++)
        for (int j = i + 1; j < s->nodes.count; j++) {
            double p[2], q[2];
            dgfem_mvci_sliver_place(s, s->nodes.data[i], p);
            dgfem_mvci_sliver_place(s, s->nodes.data[j], q);
            if (dgfem_mvci_square(p, q) < (double)(eps * eps) && !dgfem_mvci_weld_pair(s, i, j))
                return DGFEM_MVCI_REFUSED;
        }
    result = dgfem_mvci_weld(s);
    if (result <= 0) return result;
    if (!mesh->elements[element].face_count) return DGFEM_MVCI_DONE;
    if (!dgfem_mvci_sliver_nodes(s, element)) return DGFEM_MVCI_NO_MEMORY;
    result = dgfem_mvci_arrange(s, element);
    if (result > 0) result = dgfem_mvci_close_cells(s, element);
    if (result <= 0) return result;

    while (mesh->elements[element].face_count)
        dgfem_mvci_remove_face(mesh, mesh->element_faces.data[mesh->elements[element].face] / 2);
    for (int k = 0; k < s->list.count; k++)
        for (int side = 0; side < 2; side++) {
            int owner = mesh->faces[s->list.data[k]].owner[side];
            if (owner != DGFEM_NONE && !dgfem_mvci_add_element_face(mesh, owner, s->list.data[k], side))
                return DGFEM_MVCI_NO_MEMORY;
        }
    return DGFEM_MVCI_DONE;
}

/* Welds the ends of a needle's short edges. */
static int dgfem_mvci_collapse(dgfem_mvci_sliver *s, int element, dgfem_real thickness) {
    if (!dgfem_mvci_sliver_near(s) || !dgfem_mvci_weld_begin(s) || !dgfem_mvci_sliver_edges(s, element))
        return DGFEM_MVCI_NO_MEMORY;
    for (int l = 0; l < s->ends.count; l += 2) {
        int a = s->ends.data[l], b = s->ends.data[l + 1];
        if (dgfem_mvci_distance(s->mesh->rest[a], s->mesh->rest[b]) > DGFEM_R(1.5) * thickness) continue;
        if (!dgfem_mvci_weld_pair(s, dgfem_mvci_position_in(&s->nodes, a), dgfem_mvci_position_in(&s->nodes, b)))
            return DGFEM_MVCI_REFUSED;
    }
    return dgfem_mvci_weld(s);
}

/* Queues affected elements that have lost their volume. */
static int dgfem_mvci_queue_flat(dgfem_mvci_sliver *s) {
    for (int i = 0; i < s->affected.count; i++) {
        dgfem_vec3 centre;
        dgfem_real diameter;
        int other = s->affected.data[i];
        if (!s->mesh->elements[other].face_count || dgfem_mvci_position_in(&s->queue, other) != DGFEM_NONE) continue;
        dgfem_real volume = dgfem_mvci_element_measure(s->mesh, other, &centre);
        (void)dgfem_mvci_element_area(s->mesh, other, &diameter);
        if (volume <= diameter * diameter * diameter * DGFEM_R(1e-6) && !dgfem_mvci_push(s->hooks, &s->queue, other))
            return 0;
    }
    return 1;
}

/* Flattens what is queued, and what becomes flat thereby. */
static int dgfem_mvci_flatten_queued(dgfem_mvci_sliver *s) {
    for (int done = 0; done < s->queue.count; done++) {
        int element = s->queue.data[done], result;
        if (done > 8) return DGFEM_MVCI_REFUSED;
        if (!s->mesh->elements[element].face_count) continue;
        result = dgfem_mvci_flatten(s, element);
        if (result <= 0) return result;
        dgfem_status status = dgfem_mvci_mesh_settle(s->mesh, NULL);
        if (status) return status == DGFEM_ERROR_MEMORY ? DGFEM_MVCI_NO_MEMORY : DGFEM_MVCI_REFUSED;
        if (!dgfem_mvci_queue_flat(s)) return DGFEM_MVCI_NO_MEMORY;
    }
    return DGFEM_MVCI_DONE;
}

/* Whether the elements around are good, and as large together as before. */
static int dgfem_mvci_accept_removal(dgfem_mvci_sliver *s, const dgfem_mvci_mesh *before, dgfem_real quality) {
    dgfem_vec3 moment_before, moment_after;
    for (int i = 0; i < s->affected.count; i++) {
        int other = s->affected.data[i];
        if (!s->mesh->elements[other].face_count) continue;
        int closed = dgfem_mvci_element_is_closed(s->mesh, other, &s->edges);
        if (closed <= 0) return closed ? DGFEM_MVCI_NO_MEMORY : DGFEM_MVCI_REFUSED;
        if (!dgfem_mvci_element_is_good(s->mesh, other)) return DGFEM_MVCI_REFUSED;
        dgfem_real now = dgfem_mvci_element_quality(s->mesh, other);
        if (now < DGFEM_R(0.99) * quality && now < DGFEM_R(0.3) * dgfem_mvci_element_quality(before, other))
            return DGFEM_MVCI_REFUSED; /* a slab may become a wedge, to be removed next */
    }
    dgfem_real volume_before = dgfem_mvci_affected_volume(s, before, &moment_before);
    dgfem_real volume_after = dgfem_mvci_affected_volume(s, s->mesh, &moment_after);
    dgfem_real limit = volume_before * (DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-11));
    dgfem_real moment = dgfem_mvci_norm(dgfem_mvci_sub(moment_after, moment_before));
    if (!(dgfem_mvci_abs(volume_after - volume_before) <= limit)) return DGFEM_MVCI_REFUSED;
    return moment <= limit * 10 * s->diameter ? DGFEM_MVCI_DONE : DGFEM_MVCI_REFUSED;
}

/* Removes an element from s->mesh, a copy of `before`, which is spoilt where that fails. `quality` is the element's. */
static int dgfem_mvci_remove_sliver(dgfem_mvci_sliver *s, const dgfem_mvci_mesh *before, int element,
                                    dgfem_real quality) {
    dgfem_real extent[3];
    s->affected.count = s->queue.count = 0;
    if (!dgfem_mvci_sliver_nodes(s, element)) return DGFEM_MVCI_NO_MEMORY;
    dgfem_mvci_sliver_axes(s, extent);
    if (extent[0] > extent[1] / 5 && extent[1] > extent[2] / 5) return DGFEM_MVCI_REFUSED;
    if (extent[1] < extent[2] / 10) {
        int result = dgfem_mvci_collapse(s, element, extent[1]);
        if (result <= 0) return result;
    }
    if (s->mesh->elements[element].face_count && !dgfem_mvci_push(s->hooks, &s->queue, element))
        return DGFEM_MVCI_NO_MEMORY;
    dgfem_status status = dgfem_mvci_mesh_settle(s->mesh, NULL);
    if (status == DGFEM_ERROR_MEMORY) return DGFEM_MVCI_NO_MEMORY;
    if (!s->queue.count && !dgfem_mvci_queue_flat(s)) return DGFEM_MVCI_NO_MEMORY;
    if (status && !s->queue.count) return DGFEM_MVCI_REFUSED;
    int result = dgfem_mvci_flatten_queued(s);
    return result > 0 ? dgfem_mvci_accept_removal(s, before, quality) : result;
}

/* The worst changed element below the quality that has not been tried; *quality becomes its own. */
static int dgfem_mvci_worst_sliver(const dgfem_mvci_mesh *mesh, const dgfem_real *known, const char *tried,
                                   dgfem_real *quality) {
    int worst = DGFEM_NONE;
    for (int e = 0; e < mesh->element_count; e++)
        if (mesh->elements[e].face_count && !tried[e] && known[e] < *quality) worst = e, *quality = known[e];
    return worst;
}

/* Removes what is below the quality, the worst first; of changed elements only where not `all`. *mesh is replaced.
   *removed counts the elements that vanished, *left those below that could not be removed. */
static dgfem_status dgfem_mvci_mesh_remove_slivers(dgfem_mvci_mesh **mesh, dgfem_real quality, int all, int *removed,
                                                   int *left) {
    dgfem_mvci_sliver sliver;
    dgfem_hooks hooks = (*mesh)->hooks;
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&hooks);
    size_t count = (size_t)(*mesh)->element_count;
    char *tried = (char *)dgfem_mvci_take(&scratch, count, 1);
    dgfem_real *known = (dgfem_real *)dgfem_mvci_take(&scratch, count, sizeof(dgfem_real));
    dgfem_status status = tried && known ? DGFEM_OK : DGFEM_ERROR_MEMORY;
    int changed = 0;
    memset(&sliver, 0, sizeof sliver);
    sliver.hooks = &hooks;
    for (int e = 0; !status && e < (*mesh)->element_count; e++) {
        tried[e] = !all && !(*mesh)->elements[e].changed;
        if (!tried[e]) known[e] = dgfem_mvci_element_quality(*mesh, e);
    }
    while (!status) {
        dgfem_real worst = quality;
        int element = dgfem_mvci_worst_sliver(*mesh, known, tried, &worst);
        if (element == DGFEM_NONE) break;
        tried[element] = 1;
        sliver.mesh = dgfem_mvci_mesh_copy(*mesh);
        int result = sliver.mesh ? dgfem_mvci_remove_sliver(&sliver, *mesh, element, worst) : DGFEM_MVCI_NO_MEMORY;
        if (result <= 0) {
            dgfem_mvci_mesh_destroy(sliver.mesh);
            if (result < 0) status = DGFEM_ERROR_MEMORY;
            continue;
        }
        dgfem_mvci_mesh_destroy(*mesh);
        *mesh = sliver.mesh;
        changed = 1;
        for (int i = 0; i < sliver.affected.count; i++) {
            int other = sliver.affected.data[i];
            if (!(*mesh)->elements[other].face_count) {
                ++*removed;
                tried[other] = 1;
                continue;
            }
            known[other] = dgfem_mvci_element_quality(*mesh, other);
            tried[other] = 0; /* what is different may be possible */
        }
    }
    for (int e = 0; !status && e < (*mesh)->element_count; e++)
        *left += (*mesh)->elements[e].face_count && (all || (*mesh)->elements[e].changed) && known[e] < quality;
    if (!status && changed && !dgfem_mvci_mesh_compact(*mesh)) status = DGFEM_ERROR_MEMORY;
    dgfem_mvci_sliver_free(&sliver);
    dgfem_mvci_scratch_free(&scratch);
    return status;
}
