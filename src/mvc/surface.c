#pragma once
#include "skin.c"
/* The boundary of a body as triangles. */

DGFEM_API void dgfem_mvc_surface_destroy(dgfem_mvc_surface *surface) {
    if (!surface) return;
    dgfem_hooks hooks = surface->hooks;
    dgfem_mvci_free(&hooks, surface->positions);
    dgfem_mvci_free(&hooks, surface->normals);
    dgfem_mvci_free(&hooks, surface->triangles);
    dgfem_mvci_free(&hooks, surface->face);
    dgfem_mvci_free(&hooks, surface->node);
    dgfem_mvci_free(&hooks, surface);
}

/* Boundary triangles by the nodes of the body. */
static int dgfem_mvci_surface_triangles(const dgfem_mvc *body, dgfem_mvc_surface *surface) {
    for (int f = 0; f < body->face_count; f++)
        if (body->mesh->faces[f].owner[1] == DGFEM_NONE) surface->triangle_count += body->mesh->faces[f].triangle_count;
    size_t n = (size_t)surface->triangle_count;
    surface->triangles = (int *)dgfem_mvci_allocate(&surface->hooks, 3 * n, sizeof(int));
    surface->face = (int *)dgfem_mvci_allocate(&surface->hooks, n, sizeof(int));
    if (!surface->triangles || !surface->face) return 0;
    int at = 0;
    for (int f = 0; f < body->face_count; f++)
        for (int t = 0; body->mesh->faces[f].owner[1] == DGFEM_NONE && t < body->mesh->faces[f].triangle_count; t++) {
            dgfem_mvci_triangle(body->mesh, f, 0, t, surface->triangles + 3 * at);
            surface->face[at++] = f;
        }
    return 1;
}

/* Whether two triangles, of which corners c and d are at the same node, meet there along an edge that is not sharp. */
static int dgfem_mvci_is_smooth(const dgfem_mvc *body, const int *triangles, int c, int d) {
    const dgfem_real sharp = DGFEM_R(0.5); /* cos 60 degrees */
    const int *a = triangles + c - c % 3, *b = triangles + d - d % 3;
    if (a[(c % 3 + 1) % 3] != b[(d % 3 + 2) % 3] && a[(c % 3 + 2) % 3] != b[(d % 3 + 1) % 3]) return 0;
    dgfem_vec3 n = dgfem_mvci_unit(dgfem_mvci_loop_area(body->rest, a, 3));
    dgfem_vec3 m = dgfem_mvci_unit(dgfem_mvci_loop_area(body->rest, b, 3));
    return dgfem_mvci_dot(n, m) > sharp;
}

/* Makes a vertex of each class of corners at a node that are connected by smooth edges. root[3 * triangles], and
   start[nodes + 1], list[3 * triangles]: the corners at each node. */
static void dgfem_mvci_surface_vertices(const dgfem_mvc *body, dgfem_mvc_surface *surface, int *start, int *list,
                                        int *root) {
    int corners = 3 * surface->triangle_count;
    for (int c = 0; c < corners; c++) root[c] = c;
    dgfem_mvci_list_places(surface->triangles, corners, body->node_count, start, list);
    for (int i = 0; i < body->node_count; i++)
        for (int p = start[i]; p < start[i + 1]; p++)
            for (int q = p + 1; q < start[i + 1]; q++)
                if (dgfem_mvci_is_smooth(body, surface->triangles, list[p], list[q]))
                    dgfem_mvci_join(root, list[p], list[q]);
    for (int c = 0; c < corners; c++) { /* roots come first: list[c] becomes the vertex of root c */
        if (dgfem_mvci_root(root, c) != c) continue;
        surface->node[surface->vertex_count] = surface->triangles[c];
        list[c] = surface->vertex_count++;
    }
    for (int c = 0; c < corners; c++) surface->triangles[c] = list[dgfem_mvci_root(root, c)];
}

static int dgfem_mvci_surface_fill(const dgfem_mvc *body, dgfem_mvci_scratch *scratch, dgfem_mvc_surface *surface) {
    if (!dgfem_mvci_surface_triangles(body, surface)) return 0;
    size_t corners = 3 * (size_t)surface->triangle_count;
    int *start = (int *)dgfem_mvci_take(scratch, (size_t)body->node_count + 1, sizeof(int));
    int *list = (int *)dgfem_mvci_take(scratch, corners, sizeof(int));
    int *root = (int *)dgfem_mvci_take(scratch, corners, sizeof(int));
    surface->node = (int *)dgfem_mvci_allocate(&surface->hooks, corners, sizeof(int));
    if (!start || !list || !root || !surface->node) return 0;
    dgfem_mvci_surface_vertices(body, surface, start, list, root);
    size_t n = (size_t)surface->vertex_count;
    surface->positions = (dgfem_vec3 *)dgfem_mvci_allocate(&surface->hooks, n, sizeof(dgfem_vec3));
    surface->normals = (dgfem_vec3 *)dgfem_mvci_allocate(&surface->hooks, n, sizeof(dgfem_vec3));
    surface->revision = body->revision;
    surface->node_count = body->node_count;
    return surface->positions && surface->normals;
}

static void dgfem_mvci_surface_move(dgfem_mvc_surface *surface, const dgfem_mvc *body) {
    for (int v = 0; v < surface->vertex_count; v++) surface->positions[v] = body->position[surface->node[v]];
    dgfem_mvci_normals(surface->positions, surface->vertex_count, surface->triangles, surface->triangle_count,
                       surface->normals);
}

DGFEM_API dgfem_status dgfem_mvc_surface_create(const dgfem_mvc *body, dgfem_mvc_surface **out) {
    dgfem_status status = DGFEM_OK;
    if (!out) return DGFEM_ERROR_ARGUMENT;
    *out = NULL;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&body->hooks);
    dgfem_mvc_surface *surface = (dgfem_mvc_surface *)dgfem_mvci_allocate(&body->hooks, 1, sizeof *surface);
    if (surface) surface->hooks = body->hooks;
    if (!surface || !dgfem_mvci_surface_fill(body, &scratch, surface)) {
        dgfem_mvc_surface_destroy(surface);
        status = dgfem_mvci_fail_memory(&body->hooks);
    } else {
        dgfem_mvci_surface_move(surface, body);
        *out = surface;
    }
    dgfem_mvci_scratch_free(&scratch);
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_surface_update(dgfem_mvc_surface *surface, const dgfem_mvc *body) {
    if (!surface || !body) return DGFEM_ERROR_ARGUMENT;
    if (surface->revision != body->revision || surface->node_count != body->node_count)
        return dgfem_mvci_fail(&surface->hooks, DGFEM_ERROR_REVISION, "surface of revision %d, body of revision %d",
                               surface->revision, body->revision);
    dgfem_mvci_surface_move(surface, body);
    return DGFEM_OK;
}
