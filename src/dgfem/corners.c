#pragma once
#include "mesh.c"
/* Corners: classes of (vertex, element) pairs connected through glued faces around the vertex, by union-find. */

/* All (vertex, element) pairs, sorted by vertex, then element; and a forest over them that becomes the corners. The
   root of a tree is its smallest pair. */
typedef struct dgfemi_corner_pairs {
    int count;
    int *start;   /* [vertex_count + 1] pairs of vertex v: start[v] <= p < start[v + 1] */
    int *element; /* [count] ascending within a vertex */
    int *parent;  /* [count] */
} dgfemi_corner_pairs;

static int dgfemi_corner_pairs_make(const dgfem_mesh *mesh, dgfemi_arena *arena, dgfemi_corner_pairs *pairs) {
    size_t vertex_count = (size_t)mesh->vertex_count;
    int *mark = (int *)dgfemi_arena_allocate(arena, vertex_count, sizeof(int));
    int *cursor = (int *)dgfemi_arena_allocate(arena, vertex_count, sizeof(int));
    int *list = (int *)dgfemi_arena_allocate(arena, (size_t)dgfemi_mesh_max_element_corners(mesh), sizeof(int));
    int e, i, v;
    pairs->start = (int *)dgfemi_arena_allocate_zero(arena, vertex_count + 1, sizeof(int));
    if (!mark || !cursor || !list || !pairs->start) return 0;
    for (v = 0; v < mesh->vertex_count; v++) mark[v] = DGFEM_NONE;
    for (e = 0; e < mesh->element_count; e++) {
        int count = dgfemi_mesh_element_vertices(mesh, e, mark, list);
        for (i = 0; i < count; i++) pairs->start[list[i] + 1]++;
    }
    for (v = 0; v < mesh->vertex_count; v++) {
        pairs->start[v + 1] += pairs->start[v];
        cursor[v] = pairs->start[v];
        mark[v] = DGFEM_NONE;
    }
    pairs->count = pairs->start[mesh->vertex_count];
    pairs->element = (int *)dgfemi_arena_allocate(arena, (size_t)pairs->count, sizeof(int));
    pairs->parent = (int *)dgfemi_arena_allocate(arena, (size_t)pairs->count, sizeof(int));
    if (!pairs->element || !pairs->parent) return 0;
    for (e = 0; e < mesh->element_count; e++) {
        int count = dgfemi_mesh_element_vertices(mesh, e, mark, list);
        for (i = 0; i < count; i++) pairs->element[cursor[list[i]]++] = e;
    }
    for (i = 0; i < pairs->count; i++) pairs->parent[i] = i;
    return 1;
}

static int dgfemi_corner_pair_find(const dgfemi_corner_pairs *pairs, int vertex, int element) {
    int low = pairs->start[vertex], high = pairs->start[vertex + 1];
    while (high - low > 1) {
        int middle = low + (high - low) / 2;
        if (pairs->element[middle] <= element) low = middle;
        else high = middle;
    }
    DGFEM_ASSERT(low < high && pairs->element[low] == element);
    return low;
}

static int dgfemi_corner_root(int *parent, int p) {
    while (parent[p] != p) p = parent[p] = parent[parent[p]];
    return p;
}

/* Joins the two elements of every glued face at each of its vertices. */
static void dgfemi_corner_pairs_join(const dgfem_mesh *mesh, dgfemi_corner_pairs *pairs) {
    int f, l, i;
    for (f = 0; f < mesh->face_count; f++) {
        const dgfem_face *face = &mesh->faces[f];
        if (face->element[1] == DGFEM_NONE || face->cut) continue;
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            for (i = 0; i < mesh->loops[l].count; i++) {
                int v = mesh->loop_vertices[mesh->loops[l].start + i];
                int a = dgfemi_corner_root(pairs->parent, dgfemi_corner_pair_find(pairs, v, face->element[0]));
                int b = dgfemi_corner_root(pairs->parent, dgfemi_corner_pair_find(pairs, v, face->element[1]));
                if (a < b) pairs->parent[b] = a;
                else pairs->parent[a] = b;
            }
    }
}

static dgfem_corners *dgfemi_corners_new(const dgfem_mesh *mesh, int count, int pair_count) {
    const dgfem_hooks *hooks = &mesh->hooks;
    dgfem_corners *corners = (dgfem_corners *)dgfemi_allocate_zero(hooks, 1, sizeof *corners);
    if (!corners) return NULL;
    corners->hooks = *hooks;
    corners->count = count;
    corners->vertex = (int *)dgfemi_allocate(hooks, (size_t)count, sizeof(int));
    corners->element_start = (int *)dgfemi_allocate_zero(hooks, (size_t)count + 1, sizeof(int));
    corners->elements = (int *)dgfemi_allocate(hooks, (size_t)pair_count, sizeof(int));
    corners->corner_start = (int *)dgfemi_allocate_zero(hooks, (size_t)mesh->element_count + 1, sizeof(int));
    corners->corners = (int *)dgfemi_allocate(hooks, (size_t)pair_count, sizeof(int));
    if (corners->vertex && corners->element_start && corners->elements && corners->corner_start && corners->corners)
        return corners;
    dgfem_corners_destroy(corners);
    return NULL;
}

/* number[p]: the corner of pair p, numbered by their smallest pairs. Returns the number of corners. */
static int dgfemi_corners_number(dgfemi_corner_pairs *pairs, int *number) {
    int p, count = 0;
    for (p = 0; p < pairs->count; p++) {
        int root = dgfemi_corner_root(pairs->parent, p);
        number[p] = root == p ? count++ : number[root];
    }
    return count;
}

static void dgfemi_corners_fill(const dgfem_mesh *mesh, const dgfemi_corner_pairs *pairs, const int *number,
                                int *cursor, dgfem_corners *corners) {
    int p, c, e, v;
    for (p = 0; p < pairs->count; p++) {
        corners->element_start[number[p] + 1]++;
        corners->corner_start[pairs->element[p] + 1]++;
    }
    for (c = 0; c < corners->count; c++) corners->element_start[c + 1] += corners->element_start[c];
    for (e = 0; e < mesh->element_count; e++) corners->corner_start[e + 1] += corners->corner_start[e];
    memcpy(cursor, corners->element_start, (size_t)corners->count * sizeof(int));
    for (v = 0; v < mesh->vertex_count; v++)
        for (p = pairs->start[v]; p < pairs->start[v + 1]; p++) {
            corners->vertex[number[p]] = v;
            corners->elements[cursor[number[p]]++] = pairs->element[p];
        }
    memcpy(cursor, corners->corner_start, (size_t)mesh->element_count * sizeof(int));
    for (c = 0; c < corners->count; c++)
        for (p = corners->element_start[c]; p < corners->element_start[c + 1]; p++)
            corners->corners[cursor[corners->elements[p]]++] = c;
}

DGFEM_API dgfem_status dgfem_mesh_corners(const dgfem_mesh *mesh, dgfem_corners **out) {
    dgfemi_corner_pairs pairs;
    dgfemi_arena arena;
    int *number, *cursor;
    if (out) *out = NULL;
    if (!mesh) return DGFEM_ERROR_ARGUMENT;
    if (!out) return dgfemi_fail(&mesh->hooks, DGFEM_ERROR_ARGUMENT, "nowhere to put the corners");
    arena = dgfemi_arena_make(&mesh->hooks);
    if (dgfemi_corner_pairs_make(mesh, &arena, &pairs)) {
        size_t most = (size_t)(pairs.count > mesh->element_count ? pairs.count : mesh->element_count);
        number = (int *)dgfemi_arena_allocate(&arena, (size_t)pairs.count, sizeof(int));
        cursor = (int *)dgfemi_arena_allocate(&arena, most, sizeof(int));
        if (number && cursor) {
            dgfemi_corner_pairs_join(mesh, &pairs);
            *out = dgfemi_corners_new(mesh, dgfemi_corners_number(&pairs, number), pairs.count);
            if (*out) dgfemi_corners_fill(mesh, &pairs, number, cursor, *out);
        }
    }
    dgfemi_arena_free(&arena);
    return *out ? DGFEM_OK : dgfemi_fail_memory(&mesh->hooks);
}

DGFEM_API void dgfem_corners_destroy(dgfem_corners *corners) {
    dgfem_hooks hooks;
    if (!corners) return;
    hooks = corners->hooks;
    dgfemi_free(&hooks, corners->vertex);
    dgfemi_free(&hooks, corners->element_start);
    dgfemi_free(&hooks, corners->elements);
    dgfemi_free(&hooks, corners->corner_start);
    dgfemi_free(&hooks, corners->corners);
    dgfemi_free(&hooks, corners);
}
