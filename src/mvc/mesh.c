#pragma once
#include "base.c"
/* The complex of nodes, faces and elements: storage, access, measures, changes, compacting.

   All faces are planar to round-off: what would be bent is divided into triangles. So a face may be triangulated anew,
   when it gets a node on one of its edges, without any volume passing from one side to the other.

   Faces, elements and triangles are ranges of three pools. A change appends the new range behind the old ones and marks
   what it replaces as dead (face: owner[0] == DGFEM_NONE, element: face_count == 0); dgfem_mvci_mesh_compact removes
   what is dead or no longer used. Appending may move the arrays: hold indices, not pointers, across it. */

typedef struct dgfem_mvci_ints {
    int *data;
    int count, capacity;
} dgfem_mvci_ints;

typedef struct dgfem_mvci_face {
    int owner[2];                 /* [1] is DGFEM_NONE on the boundary */
    int loop, count;              /* range of mesh->loops; counter-clockwise seen from outside of owner[0] */
    int triangle, triangle_count; /* range of mesh->triangles, in triples oriented as the loop; count 0: not yet made */
    int from;                     /* face that it was, or was part of, at dgfem_mvci_mesh_begin; or DGFEM_NONE */
    int wall;                     /* 1: made by a cut */
} dgfem_mvci_face;

typedef struct dgfem_mvci_element {
    int face, face_count; /* range of mesh->element_faces */
    int from;             /* element that it was, or was part of, at dgfem_mvci_mesh_begin */
    int changed;          /* since then: to be integrated anew */
} dgfem_mvci_element;

/* Up to four nodes that a node was made from. Numbers are those of nodes at dgfem_mvci_mesh_begin, followed by those of
   all nodes made since, in the order in which they were made. */
typedef struct dgfem_mvci_birth {
    int parent[4]; /* or DGFEM_NONE */
} dgfem_mvci_birth;

typedef struct dgfem_mvci_mesh {
    int node_count, node_capacity, face_count, face_capacity, element_count, element_capacity;
    dgfem_vec3 *rest, *position, *velocity; /* [node_count] */
    int *origin;                            /* [node_count] number as in dgfem_mvci_birth */
    dgfem_mvci_face *faces;
    dgfem_mvci_element *elements;
    dgfem_mvci_ints loops;         /* nodes; hanging ones are in the loops of all faces that have their edge */
    dgfem_mvci_ints triangles;     /* three nodes each */
    dgfem_mvci_ints element_faces; /* 2 * face + side; side 1: the element is the face's owner[1] */
    int base_count;                /* nodes at dgfem_mvci_mesh_begin */
    int birth_count, birth_capacity;
    dgfem_mvci_birth *births; /* of number base_count + i */
    dgfem_hooks hooks;
} dgfem_mvci_mesh;

/* ---- access ---- */

static const int *dgfem_mvci_face_loop(const dgfem_mvci_mesh *mesh, int face, int *count) {
    *count = mesh->faces[face].count;
    return mesh->loops.data + mesh->faces[face].loop;
}

/* Triples of nodes; *count is the number of triangles. */
static const int *dgfem_mvci_face_triangles(const dgfem_mvci_mesh *mesh, int face, int *count) {
    *count = mesh->faces[face].triangle_count;
    return mesh->triangles.data + mesh->faces[face].triangle;
}

/* 2 * face + side each. */
static const int *dgfem_mvci_element_faces(const dgfem_mvci_mesh *mesh, int element, int *count) {
    *count = mesh->elements[element].face_count;
    return mesh->element_faces.data + mesh->elements[element].face;
}

/* Writes the distinct nodes of an element in the order of their first use; returns their number. mark[node_count] holds
   `element` nowhere before and at those nodes after the call, so that one array serves all elements in turn. */
static int dgfem_mvci_element_nodes(const dgfem_mvci_mesh *mesh, int element, int *mark, int *nodes) {
    int face_count, node_count = 0;
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    for (int k = 0; k < face_count; k++) {
        int count;
        const int *loop = dgfem_mvci_face_loop(mesh, faces[k] / 2, &count);
        for (int i = 0; i < count; i++) {
            if (mark[loop[i]] == element) continue;
            mark[loop[i]] = element;
            nodes[node_count++] = loop[i];
        }
    }
    return node_count;
}

/* Number of corners of an element's faces: room for its nodes, and more than its triangles. */
static int dgfem_mvci_element_corners(const dgfem_mvci_mesh *mesh, int element) {
    int face_count, sum = 0;
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    for (int k = 0; k < face_count; k++) sum += mesh->faces[faces[k] / 2].count;
    return sum;
}

static int dgfem_mvci_max_element_corners(const dgfem_mvci_mesh *mesh) {
    int most = 0;
    for (int e = 0; e < mesh->element_count; e++) {
        int corners = dgfem_mvci_element_corners(mesh, e);
        if (corners > most) most = corners;
    }
    return most;
}

/* Triangle t of a face as seen from outside of one of its sides. */
static void dgfem_mvci_triangle(const dgfem_mvci_mesh *mesh, int face, int side, int t, int nodes[3]) {
    const int *triangle = mesh->triangles.data + mesh->faces[face].triangle + 3 * t;
    nodes[0] = triangle[0];
    nodes[1] = triangle[side ? 2 : 1];
    nodes[2] = triangle[side ? 1 : 2];
}

/* Writes all triangles of an element, three nodes each, counter-clockwise from its outside; returns their number. */
static int dgfem_mvci_element_triangles(const dgfem_mvci_mesh *mesh, int element, int *triangles) {
    int face_count, written = 0;
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    for (int k = 0; k < face_count; k++)
        for (int t = 0; t < mesh->faces[faces[k] / 2].triangle_count; t++)
            dgfem_mvci_triangle(mesh, faces[k] / 2, faces[k] & 1, t, triangles + 3 * written++);
    return written;
}

/* ---- measures at rest ---- */

/* Six times the volume of the tetrahedron of a triangle, counter-clockwise from outside, and a point inside. From the
   triangle's own sides: products of the corners' distances from the point would lose a small triangle in round-off. */
static dgfem_real dgfem_mvci_tetrahedron(const dgfem_mvci_mesh *mesh, const int nodes[3], dgfem_vec3 centre) {
    dgfem_vec3 a = mesh->rest[nodes[0]];
    dgfem_vec3 b = dgfem_mvci_sub(mesh->rest[nodes[1]], a), c = dgfem_mvci_sub(mesh->rest[nodes[2]], a);
    return dgfem_mvci_dot(dgfem_mvci_cross(b, c), dgfem_mvci_sub(a, centre));
}

/* Volume, and the centroid of the volume. */
static dgfem_real dgfem_mvci_element_measure(const dgfem_mvci_mesh *mesh, int element, dgfem_vec3 *centre) {
    int face_count, nodes[3];
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    dgfem_vec3 start = mesh->rest[mesh->loops.data[mesh->faces[faces[0] / 2].loop]], sum = dgfem_mvci_vec3(0, 0, 0);
    dgfem_real volume = 0;
    for (int k = 0; k < face_count; k++)
        for (int t = 0; t < mesh->faces[faces[k] / 2].triangle_count; t++) {
            dgfem_mvci_triangle(mesh, faces[k] / 2, faces[k] & 1, t, nodes);
            dgfem_real v = dgfem_mvci_tetrahedron(mesh, nodes, start);
            volume += v;
            for (int i = 0; i < 3; i++) sum = dgfem_mvci_axpy(sum, v, dgfem_mvci_sub(mesh->rest[nodes[i]], start));
        }
    *centre = volume > 0 ? dgfem_mvci_axpy(start, 1 / (4 * volume), sum) : start;
    return volume / 6;
}

/* Smallest volume of the tetrahedra of an element's triangles and a point: positive where the point sees all of them.
   *face (may be NULL) is the triangle's. */
static dgfem_real dgfem_mvci_element_star(const dgfem_mvci_mesh *mesh, int element, dgfem_vec3 centre, int *face) {
    int face_count, nodes[3], found = 0;
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    dgfem_real smallest = 0;
    for (int k = 0; k < face_count; k++)
        for (int t = 0; t < mesh->faces[faces[k] / 2].triangle_count; t++) {
            dgfem_mvci_triangle(mesh, faces[k] / 2, faces[k] & 1, t, nodes);
            dgfem_real v = dgfem_mvci_tetrahedron(mesh, nodes, centre) / 6;
            if (found && !(v < smallest)) continue;
            found = 1, smallest = v;
            if (face) *face = faces[k] / 2;
        }
    return smallest;
}

/* Twice the vector area of a loop. */
static dgfem_vec3 dgfem_mvci_loop_area(const dgfem_vec3 *x, const int *loop, int count) {
    dgfem_vec3 sum = dgfem_mvci_vec3(0, 0, 0);
    for (int i = 2; i < count; i++)
        sum = dgfem_mvci_add(
            sum, dgfem_mvci_cross(dgfem_mvci_sub(x[loop[i - 1]], x[loop[0]]), dgfem_mvci_sub(x[loop[i]], x[loop[0]])));
    return sum;
}

static dgfem_real dgfem_mvci_distance(dgfem_vec3 a, dgfem_vec3 b) { return dgfem_mvci_norm(dgfem_mvci_sub(a, b)); }

/* Sum of the areas of an element's triangles, and the largest distance of two of its corners. */
static dgfem_real dgfem_mvci_element_area(const dgfem_mvci_mesh *mesh, int element, dgfem_real *diameter) {
    int face_count, nodes[3];
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    dgfem_real area = 0, square = 0;
    for (int k = 0; k < face_count; k++) {
        const dgfem_mvci_face *face = &mesh->faces[faces[k] / 2];
        for (int t = 0; t < face->triangle_count; t++) {
            dgfem_mvci_triangle(mesh, faces[k] / 2, 0, t, nodes);
            area += dgfem_mvci_norm(dgfem_mvci_loop_area(mesh->rest, nodes, 3)) / 2;
        }
        for (int i = 0; i < face->count; i++)
            for (int l = k; l < face_count; l++) {
                const dgfem_mvci_face *other = &mesh->faces[faces[l] / 2];
                for (int j = 0; j < other->count; j++) {
                    dgfem_vec3 d = dgfem_mvci_sub(mesh->rest[mesh->loops.data[face->loop + i]],
                                                  mesh->rest[mesh->loops.data[other->loop + j]]);
                    square = dgfem_mvci_max(square, dgfem_mvci_dot(d, d));
                }
            }
    }
    *diameter = dgfem_mvci_sqrt(square);
    return area;
}

/* 3 V / (surface * diameter). */
static dgfem_real dgfem_mvci_element_quality(const dgfem_mvci_mesh *mesh, int element) {
    dgfem_vec3 centre;
    dgfem_real diameter, volume = dgfem_mvci_element_measure(mesh, element, &centre);
    dgfem_real area = dgfem_mvci_element_area(mesh, element, &diameter);
    return area > 0 ? 3 * volume / (area * diameter) : 0;
}

static dgfem_real dgfem_mvci_mesh_volume(const dgfem_mvci_mesh *mesh) {
    dgfem_real sum = 0;
    for (int e = 0; e < mesh->element_count; e++) {
        dgfem_vec3 centre;
        if (mesh->elements[e].face_count) sum += dgfem_mvci_element_measure(mesh, e, &centre);
    }
    return sum;
}

/* ---- memory ---- */

/* Makes *data hold `extra` more items. 1 on success; on failure 0, and nothing has changed. */
static int dgfem_mvci_room(const dgfem_hooks *hooks, void **data, int count, int *capacity, int extra, size_t size) {
    if (extra > INT_MAX - count) return 0;
    if (count + extra <= *capacity) return 1;
    int wanted = *capacity < INT_MAX / 2 ? 2 * *capacity : INT_MAX;
    if (wanted < count + extra) wanted = count + extra;
    if (wanted < 16) wanted = 16;
    void *grown = dgfem_mvci_reallocate(hooks, *data, (size_t)wanted, size);
    if (!grown) return 0;
    *data = grown;
    *capacity = wanted;
    return 1;
}

static int dgfem_mvci_ints_room(const dgfem_hooks *hooks, dgfem_mvci_ints *ints, int extra) {
    void *data = ints->data;
    int ok = dgfem_mvci_room(hooks, &data, ints->count, &ints->capacity, extra, sizeof(int));
    ints->data = (int *)data;
    return ok;
}

static int dgfem_mvci_push(const dgfem_hooks *hooks, dgfem_mvci_ints *ints, int value) {
    if (!dgfem_mvci_ints_room(hooks, ints, 1)) return 0;
    ints->data[ints->count++] = value;
    return 1;
}

/* Start of the copy, or DGFEM_NONE when out of memory. `source` must not lie in the pool. */
static int dgfem_mvci_append(const dgfem_hooks *hooks, dgfem_mvci_ints *pool, const int *source, int count) {
    if (!dgfem_mvci_ints_room(hooks, pool, count)) return DGFEM_NONE;
    if (count) memcpy(pool->data + pool->count, source, (size_t)count * sizeof(int));
    pool->count += count;
    return pool->count - count;
}

static void dgfem_mvci_mesh_destroy(dgfem_mvci_mesh *mesh) {
    if (!mesh) return;
    dgfem_hooks hooks = mesh->hooks;
    dgfem_mvci_free(&hooks, mesh->rest);
    dgfem_mvci_free(&hooks, mesh->position);
    dgfem_mvci_free(&hooks, mesh->velocity);
    dgfem_mvci_free(&hooks, mesh->origin);
    dgfem_mvci_free(&hooks, mesh->faces);
    dgfem_mvci_free(&hooks, mesh->elements);
    dgfem_mvci_free(&hooks, mesh->loops.data);
    dgfem_mvci_free(&hooks, mesh->triangles.data);
    dgfem_mvci_free(&hooks, mesh->element_faces.data);
    dgfem_mvci_free(&hooks, mesh->births);
    dgfem_mvci_free(&hooks, mesh);
}

static dgfem_mvci_mesh *dgfem_mvci_mesh_new(const dgfem_hooks *hooks) {
    dgfem_mvci_mesh *mesh = (dgfem_mvci_mesh *)dgfem_mvci_allocate(hooks, 1, sizeof *mesh);
    if (mesh) mesh->hooks = *hooks;
    return mesh;
}

static int dgfem_mvci_ints_copy(const dgfem_hooks *hooks, const dgfem_mvci_ints *from, dgfem_mvci_ints *to) {
    to->count = to->capacity = from->count;
    to->data = (int *)dgfem_mvci_duplicate(hooks, from->data, (size_t)from->count, sizeof(int));
    return to->data != NULL;
}

/* NULL when out of memory. */
static dgfem_mvci_mesh *dgfem_mvci_mesh_copy(const dgfem_mvci_mesh *mesh) {
    const dgfem_hooks *hooks = &mesh->hooks;
    dgfem_mvci_mesh *copy = dgfem_mvci_mesh_new(hooks);
    size_t nodes = (size_t)mesh->node_count;
    if (!copy) return NULL;
    copy->node_count = copy->node_capacity = mesh->node_count;
    copy->face_count = copy->face_capacity = mesh->face_count;
    copy->element_count = copy->element_capacity = mesh->element_count;
    copy->base_count = mesh->base_count;
    copy->birth_count = copy->birth_capacity = mesh->birth_count;
    copy->rest = (dgfem_vec3 *)dgfem_mvci_duplicate(hooks, mesh->rest, nodes, sizeof(dgfem_vec3));
    copy->position = (dgfem_vec3 *)dgfem_mvci_duplicate(hooks, mesh->position, nodes, sizeof(dgfem_vec3));
    copy->velocity = (dgfem_vec3 *)dgfem_mvci_duplicate(hooks, mesh->velocity, nodes, sizeof(dgfem_vec3));
    copy->origin = (int *)dgfem_mvci_duplicate(hooks, mesh->origin, nodes, sizeof(int));
    copy->faces =
        (dgfem_mvci_face *)dgfem_mvci_duplicate(hooks, mesh->faces, (size_t)mesh->face_count, sizeof *mesh->faces);
    copy->elements = (dgfem_mvci_element *)dgfem_mvci_duplicate(hooks, mesh->elements, (size_t)mesh->element_count,
                                                                sizeof *mesh->elements);
    copy->births =
        (dgfem_mvci_birth *)dgfem_mvci_duplicate(hooks, mesh->births, (size_t)mesh->birth_count, sizeof *mesh->births);
    if (copy->rest && copy->position && copy->velocity && copy->origin && copy->faces && copy->elements &&
        copy->births && dgfem_mvci_ints_copy(hooks, &mesh->loops, &copy->loops) &&
        dgfem_mvci_ints_copy(hooks, &mesh->triangles, &copy->triangles) &&
        dgfem_mvci_ints_copy(hooks, &mesh->element_faces, &copy->element_faces))
        return copy;
    dgfem_mvci_mesh_destroy(copy);
    return NULL;
}

/* ---- classes and lists ---- */

/* The root of the class of i, which is its own parent. */
static int dgfem_mvci_root(int *parent, int i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

/* Makes the classes of a and b one, with the lower root. */
static void dgfem_mvci_join(int *parent, int a, int b) {
    a = dgfem_mvci_root(parent, a), b = dgfem_mvci_root(parent, b);
    if (a < b) parent[b] = a;
    else parent[a] = b;
}

/* Lists the places of each key, ascending: list[start[k]] up to list[start[k + 1] - 1]. DGFEM_NONE is no key.
   start[keys + 1] comes zeroed. */
static void dgfem_mvci_list_places(const int *key, int count, int keys, int *start, int *list) {
    for (int i = 0; i < count; i++)
        if (key[i] != DGFEM_NONE) start[key[i] + 1]++;
    for (int k = 0; k < keys; k++) start[k + 1] += start[k];
    int total = start[keys];
    for (int i = count - 1; i >= 0; i--)
        if (key[i] != DGFEM_NONE) list[--start[key[i] + 1]] = i;
    for (int k = 0; k < keys; k++) start[k] = start[k + 1]; /* each has come down to its beginning */
    start[keys] = total;
}

/* ---- edges ---- */

/* Open addressing from a pair of nodes to a value. Zeroed memory is a table without room. */
typedef struct dgfem_mvci_edge {
    int a, b, value;
    unsigned stamp; /* used where it is that of the table */
} dgfem_mvci_edge;

typedef struct dgfem_mvci_edges {
    dgfem_mvci_edge *slots;
    size_t size; /* a power of two */
    unsigned stamp;
} dgfem_mvci_edges;

/* Empties the table and makes room for so many pairs. 0 when out of memory. */
static int dgfem_mvci_edges_reset(const dgfem_hooks *hooks, dgfem_mvci_edges *edges, int pairs) {
    size_t size = 16;
    while (size < 2 * (size_t)pairs) size *= 2;
    if (size > edges->size || edges->stamp == UINT_MAX) {
        dgfem_mvci_free(hooks, edges->slots);
        edges->size = 0;
        edges->slots = (dgfem_mvci_edge *)dgfem_mvci_allocate(hooks, size, sizeof *edges->slots);
        if (!edges->slots) return 0;
        edges->size = size;
        edges->stamp = 0;
    }
    edges->stamp++;
    return 1;
}

/* The pair's slot; a new one has the value DGFEM_NONE. */
static dgfem_mvci_edge *dgfem_mvci_edges_at(dgfem_mvci_edges *edges, int a, int b) {
    uint64_t key = (uint64_t)(uint32_t)a << 32 | (uint32_t)b;
    key = (key ^ key >> 31) * 0x9e3779b97f4a7c15u;
    for (size_t slot = (size_t)(key >> 24) & (edges->size - 1);; slot = (slot + 1) & (edges->size - 1)) {
        dgfem_mvci_edge *edge = &edges->slots[slot];
        if (edge->stamp != edges->stamp) {
            edge->a = a, edge->b = b, edge->value = DGFEM_NONE;
            edge->stamp = edges->stamp;
            return edge;
        }
        if (edge->a == a && edge->b == b) return edge;
    }
}

/* The value of a pair, DGFEM_NONE where it is not in the table. */
static int dgfem_mvci_edges_find(const dgfem_mvci_edges *edges, int a, int b) {
    uint64_t key = (uint64_t)(uint32_t)a << 32 | (uint32_t)b;
    key = (key ^ key >> 31) * 0x9e3779b97f4a7c15u;
    for (size_t slot = (size_t)(key >> 24) & (edges->size - 1);; slot = (slot + 1) & (edges->size - 1)) {
        const dgfem_mvci_edge *edge = &edges->slots[slot];
        if (edge->stamp != edges->stamp) return DGFEM_NONE;
        if (edge->a == a && edge->b == b) return edge->value;
    }
}

/* The same for an edge either way. */
static dgfem_mvci_edge *dgfem_mvci_edges_between(dgfem_mvci_edges *edges, int a, int b) {
    return dgfem_mvci_edges_at(edges, a < b ? a : b, a < b ? b : a);
}
static int dgfem_mvci_edges_find_between(const dgfem_mvci_edges *edges, int a, int b) {
    return dgfem_mvci_edges_find(edges, a < b ? a : b, a < b ? b : a);
}

/* ---- changes: 0 or DGFEM_NONE when out of memory, and then the mesh may only be destroyed ---- */

static int dgfem_mvci_mesh_node_room(dgfem_mvci_mesh *mesh, int extra) {
    const dgfem_hooks *hooks = &mesh->hooks;
    void *data[4];
    int ok = 1, capacity = mesh->node_capacity;
    data[0] = mesh->rest, data[1] = mesh->position, data[2] = mesh->velocity, data[3] = mesh->origin;
    for (int i = 0; i < 4 && ok; i++) {
        capacity = mesh->node_capacity;
        ok = dgfem_mvci_room(hooks, &data[i], mesh->node_count, &capacity, extra,
                             i < 3 ? sizeof(dgfem_vec3) : sizeof(int));
    }
    mesh->rest = (dgfem_vec3 *)data[0], mesh->position = (dgfem_vec3 *)data[1];
    mesh->velocity = (dgfem_vec3 *)data[2], mesh->origin = (int *)data[3];
    if (ok) mesh->node_capacity = capacity;
    return ok;
}

/* A node between `count` others (at most four) with weights that sum to 1. Returns its index. */
static int dgfem_mvci_add_node(dgfem_mvci_mesh *mesh, const int *parents, const dgfem_real *weights, int count) {
    dgfem_vec3 zero = dgfem_mvci_vec3(0, 0, 0);
    void *births = mesh->births;
    DGFEM_ASSERT(count <= 4);
    if (!dgfem_mvci_mesh_node_room(mesh, 1)) return DGFEM_NONE;
    int ok = dgfem_mvci_room(&mesh->hooks, &births, mesh->birth_count, &mesh->birth_capacity, 1, sizeof *mesh->births);
    mesh->births = (dgfem_mvci_birth *)births;
    if (!ok) return DGFEM_NONE;
    int node = mesh->node_count++;
    dgfem_mvci_birth *birth = &mesh->births[mesh->birth_count];
    mesh->rest[node] = mesh->position[node] = mesh->velocity[node] = zero;
    mesh->origin[node] = mesh->base_count + mesh->birth_count++;
    for (int i = 0; i < 4; i++) {
        birth->parent[i] = i < count ? mesh->origin[parents[i]] : DGFEM_NONE;
        if (i >= count) continue;
        mesh->rest[node] = dgfem_mvci_axpy(mesh->rest[node], weights[i], mesh->rest[parents[i]]);
        mesh->position[node] = dgfem_mvci_axpy(mesh->position[node], weights[i], mesh->position[parents[i]]);
        mesh->velocity[node] = dgfem_mvci_axpy(mesh->velocity[node], weights[i], mesh->velocity[parents[i]]);
    }
    return node;
}

/* A node at (1 - t) a + t b. */
static int dgfem_mvci_add_node_between(dgfem_mvci_mesh *mesh, int a, int b, dgfem_real t) {
    int parents[2];
    dgfem_real weights[2];
    parents[0] = a, parents[1] = b;
    weights[0] = 1 - t, weights[1] = t;
    return dgfem_mvci_add_node(mesh, parents, weights, 2);
}

static int dgfem_mvci_copy_node(dgfem_mvci_mesh *mesh, int node) {
    dgfem_real one = 1;
    return dgfem_mvci_add_node(mesh, &node, &one, 1);
}

static void dgfem_mvci_touch_face(dgfem_mvci_mesh *mesh, int face) {
    for (int side = 0; side < 2; side++)
        if (mesh->faces[face].owner[side] != DGFEM_NONE) mesh->elements[mesh->faces[face].owner[side]].changed = 1;
}

/* Gives a face other nodes; it has no triangles then. `loop` must not lie in the pool. */
static int dgfem_mvci_set_loop(dgfem_mvci_mesh *mesh, int face, const int *loop, int count) {
    dgfem_mvci_face *f = &mesh->faces[face];
    if (count <= f->count) {
        memcpy(mesh->loops.data + f->loop, loop, (size_t)count * sizeof(int));
    } else {
        int start = dgfem_mvci_append(&mesh->hooks, &mesh->loops, loop, count);
        if (start == DGFEM_NONE) return 0;
        f->loop = start;
    }
    f->count = count;
    f->triangle_count = 0;
    dgfem_mvci_touch_face(mesh, face);
    return 1;
}

/* A new face, that its elements do not list yet. `loop` must not lie in the pool. Returns its index. */
static int dgfem_mvci_add_face(dgfem_mvci_mesh *mesh, int owner0, int owner1, const int *loop, int count, int from,
                               int wall) {
    void *faces = mesh->faces;
    int ok = dgfem_mvci_room(&mesh->hooks, &faces, mesh->face_count, &mesh->face_capacity, 1, sizeof *mesh->faces);
    mesh->faces = (dgfem_mvci_face *)faces;
    int start = ok ? dgfem_mvci_append(&mesh->hooks, &mesh->loops, loop, count) : DGFEM_NONE;
    if (start == DGFEM_NONE) return DGFEM_NONE;
    dgfem_mvci_face *face = &mesh->faces[mesh->face_count];
    face->owner[0] = owner0, face->owner[1] = owner1;
    face->loop = start, face->count = count;
    face->triangle = face->triangle_count = 0;
    face->from = from, face->wall = wall;
    dgfem_mvci_touch_face(mesh, mesh->face_count);
    return mesh->face_count++;
}

/* One more face of an element. */
static int dgfem_mvci_add_element_face(dgfem_mvci_mesh *mesh, int element, int face, int side) {
    dgfem_mvci_ints *pool = &mesh->element_faces;
    if (!dgfem_mvci_ints_room(&mesh->hooks, pool, mesh->elements[element].face_count + 1)) return 0;
    dgfem_mvci_element *e = &mesh->elements[element];
    if (e->face + e->face_count != pool->count) {
        memcpy(pool->data + pool->count, pool->data + e->face, (size_t)e->face_count * sizeof(int));
        e->face = pool->count;
        pool->count += e->face_count;
    }
    pool->data[pool->count++] = 2 * face + side;
    e->face_count++;
    e->changed = 1;
    return 1;
}

static void dgfem_mvci_remove_element_face(dgfem_mvci_mesh *mesh, int element, int face) {
    dgfem_mvci_element *e = &mesh->elements[element];
    int *list = mesh->element_faces.data + e->face, kept = 0;
    for (int k = 0; k < e->face_count; k++)
        if (list[k] / 2 != face) list[kept++] = list[k];
    e->face_count = kept;
    e->changed = 1;
}

/* Takes a face from its elements. */
static void dgfem_mvci_remove_face(dgfem_mvci_mesh *mesh, int face) {
    dgfem_mvci_face *f = &mesh->faces[face];
    for (int side = 0; side < 2; side++)
        if (f->owner[side] != DGFEM_NONE) dgfem_mvci_remove_element_face(mesh, f->owner[side], face);
    f->owner[0] = f->owner[1] = DGFEM_NONE;
}

/* An element without faces, a part of another. */
static int dgfem_mvci_add_element(dgfem_mvci_mesh *mesh, int from) {
    void *elements = mesh->elements;
    int ok = dgfem_mvci_room(&mesh->hooks, &elements, mesh->element_count, &mesh->element_capacity, 1,
                             sizeof *mesh->elements);
    mesh->elements = (dgfem_mvci_element *)elements;
    if (!ok) return DGFEM_NONE;
    dgfem_mvci_element *element = &mesh->elements[mesh->element_count];
    memset(element, 0, sizeof *element);
    element->from = from;
    element->changed = 1;
    return mesh->element_count++;
}

/* ---- history and compacting ---- */

/* From here on is recorded where nodes, faces and elements come from and what changes. */
static void dgfem_mvci_mesh_begin(dgfem_mvci_mesh *mesh) {
    mesh->base_count = mesh->node_count;
    mesh->birth_count = 0;
    for (int i = 0; i < mesh->node_count; i++) mesh->origin[i] = i;
    for (int f = 0; f < mesh->face_count; f++) mesh->faces[f].from = f;
    for (int e = 0; e < mesh->element_count; e++) mesh->elements[e].from = e, mesh->elements[e].changed = 0;
}

/* What nodes inherit from those at dgfem_mvci_mesh_begin: marked is each that has, or whose parents all have, a mark.
   mark[base_count + birth_count] comes with its first base_count members set; that of node i is then
   mark[origin[i]]. */
static void dgfem_mvci_mesh_inherit(const dgfem_mvci_mesh *mesh, char *mark) {
    for (int b = 0; b < mesh->birth_count; b++) {
        char all = 1;
        for (int i = 0; i < 4; i++)
            if (mesh->births[b].parent[i] != DGFEM_NONE && !mark[mesh->births[b].parent[i]]) all = 0;
        mark[mesh->base_count + b] = all;
    }
}

static void dgfem_mvci_compact_nodes(dgfem_mvci_mesh *mesh, int *number) {
    int kept = 0;
    for (int i = 0; i < mesh->node_count; i++) number[i] = DGFEM_NONE;
    for (int f = 0; f < mesh->face_count; f++) {
        int count = mesh->faces[f].owner[0] == DGFEM_NONE ? 0 : mesh->faces[f].count;
        for (int i = 0; i < count; i++) number[mesh->loops.data[mesh->faces[f].loop + i]] = 0;
    }
    for (int i = 0; i < mesh->node_count; i++) {
        if (number[i] == DGFEM_NONE) continue;
        mesh->rest[kept] = mesh->rest[i];
        mesh->position[kept] = mesh->position[i];
        mesh->velocity[kept] = mesh->velocity[i];
        mesh->origin[kept] = mesh->origin[i];
        number[i] = kept++;
    }
    mesh->node_count = kept;
}

static void dgfem_mvci_compact_elements(dgfem_mvci_mesh *mesh, int *number) {
    int kept = 0;
    for (int e = 0; e < mesh->element_count; e++) {
        number[e] = mesh->elements[e].face_count ? kept : DGFEM_NONE;
        if (mesh->elements[e].face_count) mesh->elements[kept++] = mesh->elements[e];
    }
    mesh->element_count = kept;
}

/* The live faces, with their loops and triangles in order, into new pools. */
static void dgfem_mvci_compact_faces(dgfem_mvci_mesh *mesh, const int *node, const int *element, int *number,
                                     dgfem_mvci_ints *loops, dgfem_mvci_ints *triangles) {
    int kept = 0;
    for (int f = 0; f < mesh->face_count; f++) {
        dgfem_mvci_face face = mesh->faces[f];
        number[f] = DGFEM_NONE;
        if (face.owner[0] == DGFEM_NONE) continue;
        int loop = loops->count, triangle = triangles->count;
        for (int i = 0; i < face.count; i++) loops->data[loops->count++] = node[mesh->loops.data[face.loop + i]];
        for (int i = 0; i < 3 * face.triangle_count; i++)
            triangles->data[triangles->count++] = node[mesh->triangles.data[face.triangle + i]];
        face.loop = loop, face.triangle = triangle;
        for (int side = 0; side < 2; side++)
            if (face.owner[side] != DGFEM_NONE) face.owner[side] = element[face.owner[side]];
        mesh->faces[kept] = face;
        number[f] = kept++;
    }
    mesh->face_count = kept;
}

/* Removes what is dead or unused; the rest keeps its order. 0 when out of memory, and nothing has changed. */
static int dgfem_mvci_mesh_compact(dgfem_mvci_mesh *mesh) {
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&mesh->hooks);
    dgfem_mvci_ints loops, triangles, lists;
    int *node = (int *)dgfem_mvci_take(&scratch, (size_t)mesh->node_count, sizeof(int));
    int *face = (int *)dgfem_mvci_take(&scratch, (size_t)mesh->face_count, sizeof(int));
    int *element = (int *)dgfem_mvci_take(&scratch, (size_t)mesh->element_count, sizeof(int));
    memset(&loops, 0, sizeof loops);
    memset(&triangles, 0, sizeof triangles);
    memset(&lists, 0, sizeof lists);
    int ok = node && face && element && dgfem_mvci_ints_room(&mesh->hooks, &loops, mesh->loops.count) &&
             dgfem_mvci_ints_room(&mesh->hooks, &triangles, mesh->triangles.count) &&
             dgfem_mvci_ints_room(&mesh->hooks, &lists, mesh->element_faces.count);
    if (ok) {
        dgfem_mvci_compact_nodes(mesh, node);
        dgfem_mvci_compact_elements(mesh, element);
        dgfem_mvci_compact_faces(mesh, node, element, face, &loops, &triangles);
        for (int e = 0; e < mesh->element_count; e++) {
            dgfem_mvci_element *item = &mesh->elements[e];
            int start = lists.count;
            for (int k = 0; k < item->face_count; k++) {
                int entry = mesh->element_faces.data[item->face + k];
                lists.data[lists.count++] = 2 * face[entry / 2] + (entry & 1);
            }
            item->face = start;
        }
        dgfem_mvci_ints old[3];
        old[0] = mesh->loops, old[1] = mesh->triangles, old[2] = mesh->element_faces;
        mesh->loops = loops, mesh->triangles = triangles, mesh->element_faces = lists;
        loops = old[0], triangles = old[1], lists = old[2];
    }
    dgfem_mvci_free(&mesh->hooks, loops.data);
    dgfem_mvci_free(&mesh->hooks, triangles.data);
    dgfem_mvci_free(&mesh->hooks, lists.data);
    dgfem_mvci_scratch_free(&scratch);
    return ok;
}
