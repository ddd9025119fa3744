#pragma once
#include "embed.c"
/* Render meshes that follow a body: by mean value coordinates in the element that contains a vertex, or by moving least
   squares over the nodes around it. */

DGFEM_API dgfem_mvc_skin_desc dgfem_default_mvc_skin_desc(void) {
    dgfem_mvc_skin_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_MVC_COOKIE;
    desc.kind = DGFEM_MVC_SKIN_MEAN_VALUE;
    return desc;
}

/* ---- normals ---- */

/* Unit normals of vertices, each triangle's weighted by its angle there. */
static void dgfem_mvci_normals(const dgfem_vec3 *x, int count, const int *triangles, int triangle_count,
                               dgfem_vec3 *normals) {
    for (int i = 0; i < count; i++) normals[i] = dgfem_mvci_vec3(0, 0, 0);
    for (int t = 0; t < triangle_count; t++) {
        const int *at = triangles + 3 * t;
        dgfem_vec3 normal = dgfem_mvci_unit(dgfem_mvci_loop_area(x, at, 3));
        for (int i = 0; i < 3; i++) {
            dgfem_vec3 a = dgfem_mvci_sub(x[at[(i + 1) % 3]], x[at[i]]);
            dgfem_vec3 b = dgfem_mvci_sub(x[at[(i + 2) % 3]], x[at[i]]);
            dgfem_real s = dgfem_mvci_norm(dgfem_mvci_cross(a, b)), c = dgfem_mvci_dot(a, b);
            normals[at[i]] = dgfem_mvci_axpy(normals[at[i]], (dgfem_real)atan2((double)s, (double)c), normal);
        }
    }
    for (int i = 0; i < count; i++) normals[i] = dgfem_mvci_unit(normals[i]);
}

/* ---- weights ---- */

typedef struct dgfem_mvci_weights {
    dgfem_mvci_grid grid;
    dgfem_mvci_shape shape; /* nodes, triangles, places of one element */
    int *index;
    dgfem_mvci_mls mls; /* of skins that ask for it */
    int count;          /* of the vertex at hand: */
    const int *nodes;
    dgfem_real *phi;
} dgfem_mvci_weights;

static int dgfem_mvci_weights_reserve(const dgfem_mvc *body, dgfem_mvc_skin_kind kind, dgfem_mvci_scratch *scratch,
                                      dgfem_mvci_weights *w) {
    size_t corners = (size_t)dgfem_mvci_max_element_corners(body->mesh), nodes = (size_t)body->node_count;
    memset(w, 0, sizeof *w);
    w->shape.triangles = (int *)dgfem_mvci_take(scratch, 3 * corners, sizeof(int));
    w->shape.x = (dgfem_vec3 *)dgfem_mvci_take(scratch, corners, sizeof(dgfem_vec3));
    w->phi = (dgfem_real *)dgfem_mvci_take(scratch, corners > nodes ? corners : nodes, sizeof(dgfem_real));
    w->index = (int *)dgfem_mvci_take(scratch, nodes, sizeof(int));
    if (!w->shape.triangles || !w->shape.x || !w->phi || !w->index) return 0;
    if (kind == DGFEM_MVC_SKIN_MLS && !dgfem_mvci_mls_create(body, scratch, &w->mls)) return 0;
    return dgfem_mvci_grid_create(body, scratch, &w->grid);
}

/* w->nodes and w->phi by mean value coordinates of `inside`, in element e. */
static void dgfem_mvci_mean_value_weights(const dgfem_mvc *body, int e, dgfem_vec3 x, dgfem_vec3 inside,
                                          dgfem_mvci_weights *w) {
    dgfem_vec3 beyond = dgfem_mvci_sub(x, inside);
    dgfem_mvci_shape_take(body, body->system, e, w->index, &w->shape);
    (void)dgfem_mvci_basis(w->shape.x, w->shape.node_count, w->shape.triangles, w->shape.triangle_count, inside, w->phi,
                           NULL);
    for (int i = 0; i < w->shape.node_count; i++) w->phi[i] += dgfem_mvci_dot(w->shape.mean[i], beyond);
    w->count = w->shape.node_count;
    w->nodes = w->shape.nodes;
}

/* Fills w->nodes and w->phi; returns the element that x belongs to. */
static int dgfem_mvci_weights_at(const dgfem_mvc *body, dgfem_mvc_skin_kind kind, dgfem_vec3 x, dgfem_mvci_weights *w) {
    int e = dgfem_mvci_locate(body, &w->grid, x);
    dgfem_vec3 inside = x;
    if (e == DGFEM_NONE) inside = dgfem_mvci_nearest_on_boundary(body, x, &e);
    if (kind == DGFEM_MVC_SKIN_MLS) {
        w->count = dgfem_mvci_mls_weights(body, &w->mls, e, x, inside, w->phi);
        w->nodes = w->mls.samples;
        if (w->count) return e;
    }
    dgfem_mvci_mean_value_weights(body, e, x, inside, w);
    return e;
}

/* Element and weights of all vertices, into fresh arrays. */
static int dgfem_mvci_skin_weigh(const dgfem_mvc *body, dgfem_mvci_scratch *scratch, dgfem_mvc_skin *skin) {
    dgfem_mvci_weights w;
    int capacity = 0, used = 0, ok = dgfem_mvci_weights_reserve(body, skin->kind, scratch, &w);
    size_t n = (size_t)skin->vertex_count;
    skin->element = (int *)dgfem_mvci_allocate(&skin->hooks, n, sizeof(int));
    skin->weight_start = (int *)dgfem_mvci_allocate(&skin->hooks, n + 1, sizeof(int));
    ok = ok && skin->element && skin->weight_start;
    for (int v = 0; ok && v < skin->vertex_count; v++) {
        int half = capacity;
        skin->element[v] = dgfem_mvci_weights_at(body, skin->kind, skin->rest[v], &w);
        void *nodes = skin->weight_node, *weights = skin->weight;
        ok = dgfem_mvci_room(&skin->hooks, &nodes, used, &half, w.count, sizeof(int)) &&
             dgfem_mvci_room(&skin->hooks, &weights, used, &capacity, w.count, sizeof(dgfem_real));
        skin->weight_node = (int *)nodes, skin->weight = (dgfem_real *)weights;
        for (int i = 0; ok && i < w.count; i++) {
            if (w.phi[i] == 0) continue;
            skin->weight_node[used] = w.nodes[i];
            skin->weight[used++] = w.phi[i];
        }
        skin->weight_start[v + 1] = used;
    }
    skin->revision = body->revision;
    skin->node_count = body->node_count;
    return ok;
}

/* ---- public ---- */

static void dgfem_mvci_skin_free_weights(dgfem_mvc_skin *skin) {
    dgfem_mvci_free(&skin->hooks, skin->element);
    dgfem_mvci_free(&skin->hooks, skin->weight_start);
    dgfem_mvci_free(&skin->hooks, skin->weight_node);
    dgfem_mvci_free(&skin->hooks, skin->weight);
}

DGFEM_API void dgfem_mvc_skin_destroy(dgfem_mvc_skin *skin) {
    if (!skin) return;
    dgfem_hooks hooks = skin->hooks;
    dgfem_mvci_skin_free_weights(skin);
    dgfem_mvci_free(&hooks, skin->positions);
    dgfem_mvci_free(&hooks, skin->normals);
    dgfem_mvci_free(&hooks, skin->triangles);
    dgfem_mvci_free(&hooks, skin->rest);
    dgfem_mvci_free(&hooks, skin);
}

static void dgfem_mvci_skin_move(dgfem_mvc_skin *skin, const dgfem_mvc *body) {
    for (int v = 0; v < skin->vertex_count; v++) {
        dgfem_vec3 sum = dgfem_mvci_vec3(0, 0, 0), base = body->position[skin->weight_node[skin->weight_start[v]]];
        for (int i = skin->weight_start[v]; i < skin->weight_start[v + 1]; i++)
            sum = dgfem_mvci_axpy(sum, skin->weight[i], dgfem_mvci_sub(body->position[skin->weight_node[i]], base));
        skin->positions[v] = dgfem_mvci_add(base, sum);
    }
    if (skin->normals)
        dgfem_mvci_normals(skin->positions, skin->vertex_count, skin->triangles, skin->triangle_count, skin->normals);
}

static dgfem_status dgfem_mvci_check_skin_desc(const dgfem_mvc_skin_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    dgfem_status status = dgfem_mvci_check_points(hooks, &desc->vertices, "vertices");
    if (!status && desc->kind != DGFEM_MVC_SKIN_MEAN_VALUE && desc->kind != DGFEM_MVC_SKIN_MLS)
        status = dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "unknown kind of skin %d", (int)desc->kind);
    if (!status && desc->vertices.count < 1)
        status = dgfem_mvci_fail(hooks, DGFEM_ERROR_EMPTY, "a skin of no vertices");
    for (int v = 0; !status && v < desc->vertices.count; v++)
        if (!dgfem_mvci_is_finite3(dgfem_mvci_read_point(&desc->vertices, v)))
            status = dgfem_mvci_fail(hooks, DGFEM_ERROR_NOT_FINITE, "vertex %d", v);
    if (!status && (desc->triangle_count < 0 || (desc->triangle_count > 0 && !desc->triangles)))
        status = dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "no data for %d triangles", desc->triangle_count);
    for (int i = 0; !status && i / 3 < desc->triangle_count; i++)
        if (desc->triangles[i] < 0 || desc->triangles[i] >= desc->vertices.count)
            status = dgfem_mvci_fail(hooks, DGFEM_ERROR_INDEX, "triangle %d: vertex %d of %d", i / 3,
                                     desc->triangles[i], desc->vertices.count);
    return status;
}

/* Copies the mesh; 0 when out of memory. */
static int dgfem_mvci_skin_fill(const dgfem_mvc_skin_desc *desc, dgfem_mvc_skin *skin) {
    size_t n = (size_t)desc->vertices.count, t = (size_t)desc->triangle_count;
    skin->kind = desc->kind;
    skin->vertex_count = desc->vertices.count;
    skin->rest = (dgfem_vec3 *)dgfem_mvci_allocate(&skin->hooks, n, sizeof(dgfem_vec3));
    skin->positions = (dgfem_vec3 *)dgfem_mvci_allocate(&skin->hooks, n, sizeof(dgfem_vec3));
    if (!skin->rest || !skin->positions) return 0;
    for (int v = 0; v < skin->vertex_count; v++) skin->rest[v] = dgfem_mvci_read_point(&desc->vertices, v);
    if (!desc->triangles) return 1;
    skin->triangle_count = desc->triangle_count;
    skin->triangles = (int *)dgfem_mvci_duplicate(&skin->hooks, desc->triangles, 3 * t, sizeof(int));
    skin->normals = (dgfem_vec3 *)dgfem_mvci_allocate(&skin->hooks, n, sizeof(dgfem_vec3));
    return skin->triangles && skin->normals;
}

DGFEM_API dgfem_status dgfem_mvc_skin_create(const dgfem_mvc *body, const dgfem_mvc_skin_desc *desc,
                                             dgfem_mvc_skin **out) {
    if (!out) return DGFEM_ERROR_ARGUMENT;
    *out = NULL;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!desc || desc->cookie != DGFEM_MVC_COOKIE) return DGFEM_ERROR_DESCRIPTOR;
    dgfem_status status = dgfem_mvci_check_skin_desc(desc);
    if (status) return status;
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&desc->hooks);
    dgfem_mvc_skin *skin = (dgfem_mvc_skin *)dgfem_mvci_allocate(&desc->hooks, 1, sizeof *skin);
    if (skin) skin->hooks = desc->hooks;
    if (!skin || !dgfem_mvci_skin_fill(desc, skin) || !dgfem_mvci_skin_weigh(body, &scratch, skin)) {
        dgfem_mvc_skin_destroy(skin);
        status = dgfem_mvci_fail_memory(&desc->hooks);
    } else {
        dgfem_mvci_skin_move(skin, body);
        *out = skin;
    }
    dgfem_mvci_scratch_free(&scratch);
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_skin_renew(dgfem_mvc_skin *skin, const dgfem_mvc *body) {
    if (!skin || !body) return DGFEM_ERROR_ARGUMENT;
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&skin->hooks);
    dgfem_mvc_skin next = *skin;
    dgfem_status status = DGFEM_OK;
    next.element = next.weight_start = next.weight_node = NULL;
    next.weight = NULL;
    if (dgfem_mvci_skin_weigh(body, &scratch, &next)) {
        dgfem_mvci_skin_free_weights(skin);
        *skin = next;
        dgfem_mvci_skin_move(skin, body);
    } else {
        dgfem_mvci_skin_free_weights(&next);
        status = dgfem_mvci_fail_memory(&skin->hooks);
    }
    dgfem_mvci_scratch_free(&scratch);
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_skin_update(dgfem_mvc_skin *skin, const dgfem_mvc *body) {
    if (!skin || !body) return DGFEM_ERROR_ARGUMENT;
    if (skin->revision != body->revision || skin->node_count != body->node_count)
        return dgfem_mvci_fail(&skin->hooks, DGFEM_ERROR_REVISION, "skin of revision %d, body of revision %d",
                               skin->revision, body->revision);
    dgfem_mvci_skin_move(skin, body);
    return DGFEM_OK;
}
