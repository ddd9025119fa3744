#pragma once
#include "embed_points.c"
/* A render mesh that follows a body: positions by embedding, normals from its own triangles. */

DGFEM_API dgfem_skin_desc dgfem_default_skin_desc(void) {
    dgfem_skin_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.vertices.type = DGFEM_NUMBER_OF_REAL;
    return desc;
}

/* ---- update ---- */

#define DGFEM_SKIN_GRAIN 256

static void dgfemi_skin_positions_range(void *context, int first, int last) {
    dgfem_skin *skin = (dgfem_skin *)context;
    for (int v = first; v < last; v++) skin->positions[v] = dgfemi_add(skin->embedding->points[v], skin->positions[v]);
}

/* The vertex's share of a triangle: its unit normal times the angle between the two edges that meet in the vertex. */
static dgfem_vec3 dgfemi_corner_normal(dgfem_vec3 at, dgfem_vec3 next, dgfem_vec3 previous) {
    dgfem_vec3 a = dgfemi_sub(next, at), b = dgfemi_sub(previous, at), n = dgfemi_cross(a, b);
    dgfem_real length = dgfemi_norm(n);
    if (!(length > 0)) return dgfemi_vec3(0, 0, 0);
    return dgfemi_scale((dgfem_real)atan2((double)length, (double)dgfemi_dot(a, b)) / length, n);
}

/* A triangle mesh whose normals are wanted. */
typedef struct dgfemi_shell {
    const dgfem_vec3 *positions;
    const int *triangles, *corner_start, *corners;
    dgfem_vec3 *normals;
} dgfemi_shell;

static void dgfemi_shell_normals_range(void *context, int first, int last) {
    const dgfemi_shell *shell = (const dgfemi_shell *)context;
    for (int v = first; v < last; v++) {
        dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
        for (int i = shell->corner_start[v]; i < shell->corner_start[v + 1]; i++) {
            int corner = shell->corners[i], triangle = corner - corner % 3;
            int next = shell->triangles[triangle + (corner + 1) % 3],
                previous = shell->triangles[triangle + (corner + 2) % 3];
            sum = dgfemi_add(
                sum, dgfemi_corner_normal(shell->positions[v], shell->positions[next], shell->positions[previous]));
        }
        shell->normals[v] = dgfemi_normalized(sum);
    }
}

static void dgfemi_skin_normals(dgfem_skin *skin) {
    dgfemi_shell shell;
    if (!skin->normals) return;
    shell.positions = skin->positions, shell.triangles = skin->triangles;
    shell.corner_start = skin->corner_start, shell.corners = skin->corners, shell.normals = skin->normals;
    dgfemi_parallel_for(&skin->hooks, skin->vertex_count, DGFEM_SKIN_GRAIN, dgfemi_shell_normals_range, &shell);
}

static void dgfemi_skin_update(dgfem_skin *skin, const dgfem_body *body) {
    dgfemi_embedding_samples(skin->embedding, body, body->displacement, skin->sample_displacement);
    dgfemi_embedding_points(skin->embedding, skin->sample_displacement, skin->positions);
    dgfemi_parallel_for(&skin->hooks, skin->vertex_count, DGFEM_SKIN_GRAIN, dgfemi_skin_positions_range, skin);
    dgfemi_skin_normals(skin);
}

DGFEM_API dgfem_status dgfem_skin_update(dgfem_skin *skin, const dgfem_body *body) {
    if (!skin) return DGFEM_ERROR_ARGUMENT;
    if (!body) return dgfemi_fail(&skin->hooks, DGFEM_ERROR_ARGUMENT, "skin: no body");
    if (skin->embedding->revision != body->revision)
        return dgfemi_fail(&skin->hooks, DGFEM_ERROR_REVISION, "skin: made for revision %d of the body, which is at %d",
                           skin->embedding->revision, body->revision);
    dgfemi_skin_update(skin, body);
    return DGFEM_OK;
}

/* ---- creation ---- */

static dgfem_status dgfemi_check_skin_desc(const dgfem_skin_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    const dgfem_points_in *vertices = &desc->vertices;
    dgfem_status status =
        dgfemi_check_points(hooks, vertices->data, vertices->type, vertices->stride, vertices->count, "skin vertices");
    if (status != DGFEM_OK) return status;
    if (desc->triangle_count < 0 || desc->triangle_count > INT_MAX / 3)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "skin: %d triangles", desc->triangle_count);
    if (!desc->triangles && desc->triangle_count > 0)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "skin: no data for %d triangles", desc->triangle_count);
    for (int i = 0; i < 3 * desc->triangle_count; i++)
        if (desc->triangles[i] < 0 || desc->triangles[i] >= vertices->count)
            return dgfemi_fail(hooks, DGFEM_ERROR_INDEX, "skin triangle %d names vertex %d of %d", i / 3,
                               desc->triangles[i], vertices->count);
    return DGFEM_OK;
}

/* Lists the corners (3 * triangle + 0, 1, 2) of each vertex: normals then gather, each vertex on its own. 1 on success;
   what was allocated is the caller's in any case. */
static int dgfemi_list_corners(const dgfem_hooks *hooks, const int *triangles, int triangle_count, int vertex_count,
                               int **start, int **list) {
    int corners = 3 * triangle_count, total = 0;
    *start = (int *)dgfemi_allocate_zero(hooks, (size_t)vertex_count + 1, sizeof(int));
    *list = (int *)dgfemi_allocate(hooks, (size_t)corners, sizeof(int));
    if (!*start || !*list) return 0;
    for (int i = 0; i < corners; i++) (*start)[triangles[i]]++;
    for (int v = 0; v <= vertex_count; v++) { /* the end of each list, from where it is filled backwards */
        total += (*start)[v];
        (*start)[v] = total;
    }
    for (int i = corners - 1; i >= 0; i--) (*list)[--(*start)[triangles[i]]] = i;
    return 1;
}

static int dgfemi_skin_make_corners(dgfem_skin *skin) {
    return dgfemi_list_corners(&skin->hooks, skin->triangles, skin->triangle_count, skin->vertex_count,
                               &skin->corner_start, &skin->corners);
}

/* 1 on success, 0 when out of memory. */
static int dgfemi_skin_allocate(dgfem_skin *skin, const dgfem_skin_desc *desc) {
    const dgfem_hooks *hooks = &skin->hooks;
    skin->vertex_count = skin->original_vertex_count = desc->vertices.count;
    skin->positions = (dgfem_vec3 *)dgfemi_allocate(hooks, (size_t)skin->vertex_count, sizeof(dgfem_vec3));
    if (!skin->positions) return 0;
    if (!desc->triangles) return 1;
    skin->triangle_count = skin->original_triangle_count = desc->triangle_count;
    skin->normals = (dgfem_vec3 *)dgfemi_allocate(hooks, (size_t)skin->vertex_count, sizeof(dgfem_vec3));
    skin->triangles = (int *)dgfemi_duplicate(hooks, desc->triangles, 3 * (size_t)desc->triangle_count, sizeof(int));
    return skin->normals && skin->triangles && dgfemi_skin_make_corners(skin);
}

DGFEM_API void dgfem_skin_destroy(dgfem_skin *skin) {
    dgfem_hooks hooks;
    if (!skin) return;
    hooks = skin->hooks;
    dgfem_embedding_destroy(skin->embedding);
    dgfemi_free(&hooks, skin->positions);
    dgfemi_free(&hooks, skin->normals);
    dgfemi_free(&hooks, skin->triangles);
    dgfemi_free(&hooks, skin->corner_start);
    dgfemi_free(&hooks, skin->corners);
    dgfemi_free(&hooks, skin->parents);
    dgfemi_free(&hooks, skin->parent_weight);
    dgfemi_free(&hooks, skin->source);
    dgfemi_free(&hooks, skin->wall);
    dgfemi_free(&hooks, skin->weld);
    dgfemi_free(&hooks, skin->anchors);
    dgfemi_free(&hooks, skin->sample_displacement);
    dgfemi_free(&hooks, skin);
}

/* Weights of these points, and room for the values of their samples; what the skin had is not freed. anchors, places
   and old as in dgfemi_embedding_build. On failure the skin is as it was. */
static dgfem_status dgfemi_skin_embed(dgfem_skin *skin, const dgfem_body *body, const dgfem_points_in *points,
                                      const dgfem_vec3 *anchors, const dgfemi_places *places,
                                      const dgfem_embedding *old) {
    dgfem_embedding *embedding = NULL;
    dgfem_status status = dgfemi_embedding_create_at(body, points, anchors, places, old, &skin->hooks, &embedding);
    dgfem_vec3 *displacement;
    if (status != DGFEM_OK) return status;
    displacement = (dgfem_vec3 *)dgfemi_allocate(&skin->hooks, (size_t)embedding->sample_count, sizeof(dgfem_vec3));
    if (!displacement) {
        dgfem_embedding_destroy(embedding);
        return dgfemi_fail_memory(&skin->hooks);
    }
    skin->embedding = embedding;
    skin->sample_displacement = displacement;
    return DGFEM_OK;
}

static dgfem_status dgfemi_skin_create(const dgfem_body *body, const dgfem_skin_desc *desc, dgfem_skin **out) {
    const dgfem_hooks *hooks = &desc->hooks;
    dgfem_skin *skin = (dgfem_skin *)dgfemi_allocate_zero(hooks, 1, sizeof *skin);
    dgfem_status status = DGFEM_OK;
    if (!skin) return dgfemi_fail_memory(hooks);
    skin->hooks = *hooks;
    if (!dgfemi_skin_allocate(skin, desc)) status = dgfemi_fail_memory(hooks);
    if (status == DGFEM_OK) status = dgfemi_skin_embed(skin, body, &desc->vertices, NULL, NULL, NULL);
    if (status != DGFEM_OK) {
        dgfem_skin_destroy(skin);
        return status;
    }
    dgfemi_skin_update(skin, body);
    *out = skin;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_skin_create(const dgfem_body *body, const dgfem_skin_desc *desc, dgfem_skin **out) {
    dgfem_status status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (out) *out = NULL;
    if (status != DGFEM_OK) return status;
    if (!body || !out) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "skin: no %s", body ? "result" : "body");
    status = dgfemi_check_skin_desc(desc);
    return status == DGFEM_OK ? dgfemi_skin_create(body, desc, out) : status;
}

/* ---- renewal ---- */

/* Vertices at a cut have one position and different anchors, on their own sides; these tell their elements whatever was
   split or merged since. */
static dgfem_status dgfemi_skin_renew(dgfem_skin *skin, const dgfem_body *body) {
    const dgfem_hooks hooks = skin->hooks;
    dgfem_embedding *old = skin->embedding;
    dgfem_vec3 *old_displacement = skin->sample_displacement;
    dgfem_points_in points = dgfem_points_in_vec3(old->points, old->point_count);
    dgfem_status status = dgfemi_skin_embed(skin, body, &points, skin->anchors, NULL, old);
    if (status != DGFEM_OK) return status;
    dgfem_embedding_destroy(old);
    dgfemi_free(&hooks, old_displacement);
    dgfemi_skin_update(skin, body);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_skin_renew(dgfem_skin *skin, const dgfem_body *body) {
    if (!skin) return DGFEM_ERROR_ARGUMENT;
    if (!body) return dgfemi_fail(&skin->hooks, DGFEM_ERROR_ARGUMENT, "skin: no body");
    return dgfemi_skin_renew(skin, body);
}

/* ---- results ---- */

static dgfem_status dgfemi_write_points(const dgfem_hooks *hooks, const dgfem_vec3 *values, int count,
                                        const dgfem_points_out *out, const char *what) {
    dgfem_status status = dgfemi_check_points(hooks, out->data, out->type, out->stride, out->count, what);
    if (status != DGFEM_OK) return status;
    if (out->count < count)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: room for %d of %d", what, out->count, count);
    for (int v = 0; v < count; v++) dgfemi_point_write(out, v, values[v]);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_skin_positions(const dgfem_skin *skin, dgfem_points_out out) {
    if (!skin) return DGFEM_ERROR_ARGUMENT;
    return dgfemi_write_points(&skin->hooks, skin->positions, skin->vertex_count, &out, "skin positions");
}

DGFEM_API dgfem_status dgfem_skin_normals(const dgfem_skin *skin, dgfem_points_out out) {
    if (!skin) return DGFEM_ERROR_ARGUMENT;
    if (!skin->normals) return dgfemi_fail(&skin->hooks, DGFEM_ERROR_ARGUMENT, "skin normals: it has no triangles");
    return dgfemi_write_points(&skin->hooks, skin->normals, skin->vertex_count, &out, "skin normals");
}
