#pragma once
#include "mesh.c"
#include "polyhedron.c"
/* Components, connected over edges, of a set of oriented faces; voids find the component that encloses them.

   A set of faces is a list of codes 2 * face + (1 where the face's normal points inwards). */

/* ---- map from edges to indices ---- */

typedef struct dgfemi_edge_slot {
    int a, b; /* a < b */
    int value;
    unsigned generation;
} dgfemi_edge_slot;

/* Open addressing. A slot of an older generation is empty, so that emptying the map costs nothing. */
typedef struct dgfemi_edge_map {
    dgfemi_edge_slot *slots;
    size_t capacity, size; /* allocated and in use, powers of two */
    size_t count;
    unsigned generation;
} dgfemi_edge_map;

/* Empties the map and fits it to about so many edges. 1 on success, 0 when out of memory. */
static int dgfemi_edge_map_begin(const dgfem_hooks *hooks, dgfemi_edge_map *map, size_t expected) {
    size_t size = 16;
    while (size < 2 * expected) size *= 2;
    map->count = 0;
    if (size > map->capacity) {
        dgfemi_edge_slot *slots = (dgfemi_edge_slot *)dgfemi_allocate_zero(hooks, size, sizeof(dgfemi_edge_slot));
        if (!slots) return 0;
        dgfemi_free(hooks, map->slots);
        map->slots = slots, map->capacity = size, map->generation = 0;
    }
    map->size = size;
    if (++map->generation == 0) {
        memset(map->slots, 0, map->capacity * sizeof(dgfemi_edge_slot));
        map->generation = 1;
    }
    return 1;
}

static int dgfemi_edge_map_has(const dgfemi_edge_map *map, const dgfemi_edge_slot *slot) {
    return slot->generation == map->generation;
}

/* The slot of the edge, or the empty one where it belongs. */
static dgfemi_edge_slot *dgfemi_edge_map_at(const dgfemi_edge_map *map, int a, int b) {
    int low = a < b ? a : b, high = a < b ? b : a;
    size_t i = (size_t)dgfemi_hash_pair(low, high) & (map->size - 1);
    while (map->slots[i].generation == map->generation && (map->slots[i].a != low || map->slots[i].b != high))
        i = (i + 1) & (map->size - 1);
    return &map->slots[i];
}

static void dgfemi_edge_map_fill(dgfemi_edge_map *map, dgfemi_edge_slot *slot, int a, int b, int value) {
    slot->a = a < b ? a : b, slot->b = a < b ? b : a;
    slot->value = value;
    slot->generation = map->generation;
    map->count++;
}

/* Fills an empty slot, then sees to it that at least half of the slots are empty: slots may move. 1 on success. */
static int dgfemi_edge_map_set(const dgfem_hooks *hooks, dgfemi_edge_map *map, dgfemi_edge_slot *slot, int a, int b,
                               int value) {
    dgfemi_edge_map grown = *map;
    size_t i;
    dgfemi_edge_map_fill(map, slot, a, b, value);
    if (2 * map->count <= map->size) return 1;
    grown.capacity = grown.size = 2 * map->size;
    grown.count = 0;
    grown.slots = (dgfemi_edge_slot *)dgfemi_allocate_zero(hooks, grown.size, sizeof(dgfemi_edge_slot));
    if (!grown.slots) return 0;
    for (i = 0; i < map->size; i++) {
        const dgfemi_edge_slot *old = &map->slots[i];
        if (!dgfemi_edge_map_has(map, old)) continue;
        dgfemi_edge_map_fill(&grown, dgfemi_edge_map_at(&grown, old->a, old->b), old->a, old->b, old->value);
    }
    dgfemi_free(hooks, map->slots);
    *map = grown;
    return 1;
}

/* ---- components ---- */

/* Zeroed memory with `mesh` set is a valid one; it serves many sets. */
typedef struct dgfemi_parts {
    const dgfem_mesh *mesh;
    const int *codes;       /* the set at hand */
    int code_count;
    int count;              /* number of components */
    int crowded;            /* 1: some edge has more than two faces */
    int *component;         /* [code_count] numbered in the order of their first faces */
    int *parent;            /* [code_count] union-find */
    dgfem_real *volume;     /* [count] once measured */
    int component_capacity, parent_capacity, volume_capacity;
    dgfemi_edge_map edges;  /* edge -> position in the set */
} dgfemi_parts;

static void dgfemi_parts_free(dgfemi_parts *c) {
    const dgfem_hooks *hooks = &c->mesh->hooks;
    dgfemi_free(hooks, c->component);
    dgfemi_free(hooks, c->parent);
    dgfemi_free(hooks, c->volume);
    dgfemi_free(hooks, c->edges.slots);
}

/* Joins face k of the set with those that it shares edges with. 1 on success, 0 when out of memory. */
static int dgfemi_parts_join(dgfemi_parts *c, int k) {
    const dgfem_mesh *mesh = c->mesh;
    const dgfem_face *face = &mesh->faces[c->codes[k] / 2];
    int l, i;
    for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        int count = mesh->loops[l].count, last = loop[count - 1];
        for (i = 0; i < count; i++) {
            dgfemi_edge_slot *slot = dgfemi_edge_map_at(&c->edges, last, loop[i]);
            if (dgfemi_edge_map_has(&c->edges, slot)) {
                int other = slot->value < 0 ? ~slot->value : slot->value; /* ~: has two faces */
                int a = dgfemi_root(c->parent, other), b = dgfemi_root(c->parent, k);
                c->parent[a > b ? a : b] = a > b ? b : a;
                c->crowded |= slot->value < 0;
                slot->value = ~other;
            } else if (!dgfemi_edge_map_set(&mesh->hooks, &c->edges, slot, last, loop[i], k)) {
                return 0;
            }
            last = loop[i];
        }
    }
    return 1;
}

/* 1 on success, 0 when out of memory. */
static int dgfemi_parts_find(dgfemi_parts *c, const dgfemi_ints *codes) {
    const dgfem_mesh *mesh = c->mesh;
    void *component = c->component, *parent = c->parent;
    size_t corners = 0;
    int k, ok = dgfemi_mesh_room(&mesh->hooks, &component, 0, &c->component_capacity, codes->count, sizeof(int));
    c->component = (int *)component;
    ok = ok && dgfemi_mesh_room(&mesh->hooks, &parent, 0, &c->parent_capacity, codes->count, sizeof(int));
    c->parent = (int *)parent;
    if (!ok) return 0;
    c->codes = codes->data;
    c->code_count = codes->count;
    c->crowded = 0;
    for (k = 0; k < c->code_count; k++) {
        c->parent[k] = k;
        corners += (size_t)dgfemi_mesh_face_corners(mesh, c->codes[k] / 2);
    }
    if (!dgfemi_edge_map_begin(&mesh->hooks, &c->edges, corners / 2 + 1)) return 0;
    for (k = 0; k < c->code_count; k++)
        if (!dgfemi_parts_join(c, k)) return 0;
    for (c->count = 0, k = 0; k < c->code_count; k++) {
        int root = dgfemi_root(c->parent, k);
        c->component[k] = root == k ? c->count++ : c->component[root];
    }
    return 1;
}

/* The first face of a component. */
static int dgfemi_parts_first(const dgfemi_parts *c, int component) {
    int k = 0;
    while (c->component[k] != component) k++;
    return c->codes[k] / 2;
}

/* By the same operations as dgfemi_mesh_element_measures. */
static dgfem_real dgfemi_parts_measure_one(const dgfemi_parts *c, int component) {
    dgfem_vec3 lower = dgfemi_mesh_first_vertex(c->mesh, dgfemi_parts_first(c, component)), upper = lower;
    dgfem_vec3 origin, moment = dgfemi_vec3(0, 0, 0);
    dgfem_real six = 0;
    int k;
    for (k = 0; k < c->code_count; k++)
        if (c->component[k] == component) dgfemi_mesh_face_box(c->mesh, c->codes[k] / 2, &lower, &upper);
    origin = dgfemi_add_scaled(lower, DGFEM_R(0.5), dgfemi_sub(upper, lower));
    for (k = 0; k < c->code_count; k++)
        if (c->component[k] == component)
            dgfemi_mesh_add_fan(c->mesh, c->codes[k] / 2, c->codes[k] % 2 ? DGFEM_R(-1) : DGFEM_R(1), origin, &six,
                                &moment);
    return six / 6;
}

/* Fills c->volume. 1 on success, 0 when out of memory. */
static int dgfemi_parts_measure(dgfemi_parts *c) {
    void *volume = c->volume;
    int i, ok = dgfemi_mesh_room(&c->mesh->hooks, &volume, 0, &c->volume_capacity, c->count, sizeof(dgfem_real));
    c->volume = (dgfem_real *)volume;
    for (i = 0; ok && i < c->count; i++) c->volume[i] = dgfemi_parts_measure_one(c, i);
    return ok;
}

/* ---- voids ---- */

/* Solid angle of a triangle seen from the origin, positive when the triangle runs clockwise from there: seen from
   inside, as the faces of a solid do. */
static double dgfemi_solid_angle(dgfem_vec3 a, dgfem_vec3 b, dgfem_vec3 c) {
    double la = (double)dgfemi_norm(a), lb = (double)dgfemi_norm(b), lc = (double)dgfemi_norm(c);
    double y = (double)dgfemi_dot(a, dgfemi_cross(b, c));
    double x = la * lb * lc + (double)dgfemi_dot(a, b) * lc + (double)dgfemi_dot(b, c) * la +
               (double)dgfemi_dot(c, a) * lb;
    return y > 0 || y < 0 ? 2 * atan2(y, x) : 0;
}

/* How often a component winds around a point. */
static double dgfemi_parts_winding(const dgfemi_parts *c, int component, dgfem_vec3 point) {
    const dgfem_mesh *mesh = c->mesh;
    double sum = 0;
    int k, l, i;
    for (k = 0; k < c->code_count; k++) {
        const dgfem_face *face = &mesh->faces[c->codes[k] / 2];
        double sign = c->codes[k] % 2 ? -1 : 1;
        if (c->component[k] != component) continue;
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
            const int *loop = mesh->loop_vertices + mesh->loops[l].start;
            dgfem_vec3 p = dgfemi_sub(mesh->vertices[loop[0]], point), q = dgfemi_sub(mesh->vertices[loop[1]], point);
            for (i = 2; i < mesh->loops[l].count; i++) {
                dgfem_vec3 r = dgfemi_sub(mesh->vertices[loop[i]], point);
                sum += sign * dgfemi_solid_angle(p, q, r);
                q = r;
            }
        }
    }
    return sum / 12.566370614359172; /* 4 pi */
}

/* The smallest component of positive volume around a void; DGFEM_NONE when there is none. */
static int dgfemi_parts_host(const dgfemi_parts *c, int hollow) {
    dgfem_vec3 point = dgfemi_mesh_first_vertex(c->mesh, dgfemi_parts_first(c, hollow));
    int i, host = DGFEM_NONE;
    for (i = 0; i < c->count; i++) {
        if (!(c->volume[i] > 0) || (host != DGFEM_NONE && !(c->volume[i] < c->volume[host]))) continue;
        if (dgfemi_parts_winding(c, i, point) > 0.25) host = i;
    }
    return host;
}

/* Gives every component of negative volume, a void, to the one that encloses it: its faces get that one's number, and
   its volume becomes zero. The components must have been measured. */
static dgfem_status dgfemi_parts_attach_voids(dgfemi_parts *c) {
    int i, k;
    for (i = 0; i < c->count; i++) {
        int host;
        if (!(c->volume[i] < 0)) continue;
        host = dgfemi_parts_host(c, i);
        if (host == DGFEM_NONE) {
            const dgfem_face *face = &c->mesh->faces[dgfemi_parts_first(c, i)];
            return dgfemi_fail(&c->mesh->hooks, DGFEM_ERROR_INSIDE_OUT,
                               "a part of volume %g at the face with tag %d is enclosed by nothing",
                               (double)c->volume[i], face->tag);
        }
        for (k = 0; k < c->code_count; k++)
            if (c->component[k] == i) c->component[k] = host;
        c->volume[i] = 0;
    }
    return DGFEM_OK;
}
