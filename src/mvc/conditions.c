#pragma once
#include "create.c"
/* What holds and loads a body: the list of conditions and contact shapes. */

static dgfem_status dgfem_mvci_check_items(const dgfem_mvc *body, const int *items, int count, int limit,
                                           const char *what) {
    if (count < 1 || !items)
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "condition on %d %ss", count, what);
    for (int i = 0; i < count; i++)
        if (items[i] < 0 || items[i] >= limit)
            return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_INDEX, "%s %d of %d", what, items[i], limit);
    return DGFEM_OK;
}

static dgfem_status dgfem_mvci_check_loaded_faces(const dgfem_mvc *body, const int *faces, int count) {
    dgfem_status status = dgfem_mvci_check_items(body, faces, count, body->face_count, "face");
    for (int i = 0; !status && i < count; i++)
        if (body->mesh->faces[faces[i]].owner[1] != DGFEM_NONE)
            status = dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "face %d is not on the boundary", faces[i]);
    return status;
}

static dgfem_status dgfem_mvci_check_real(const dgfem_mvc *body, dgfem_real x, const char *what) {
    if (dgfem_mvci_is_finite(x)) return DGFEM_OK;
    return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "%s %g", what, (double)x);
}

/* Appends a condition of checked items; the caller fills in the rest of *added. */
static dgfem_status dgfem_mvci_add_condition(dgfem_mvc *body, dgfem_mvc_condition_kind kind, const int *items,
                                             int count, int *id, dgfem_mvc_condition **added) {
    if (body->condition_count == body->condition_capacity) {
        int capacity = 2 * body->condition_capacity + 8;
        dgfem_mvc_condition *grown = (dgfem_mvc_condition *)dgfem_mvci_reallocate(&body->hooks, body->conditions,
                                                                                  (size_t)capacity, sizeof *grown);
        if (!grown) return dgfem_mvci_fail_memory(&body->hooks);
        body->conditions = grown;
        body->condition_capacity = capacity;
    }
    int shared = kind == DGFEM_MVC_CONDITION_FORCE || kind == DGFEM_MVC_CONDITION_PIN;
    int *copy = (int *)dgfem_mvci_duplicate(&body->hooks, items, (size_t)count, sizeof(int));
    dgfem_real *share =
        shared ? (dgfem_real *)dgfem_mvci_allocate(&body->hooks, (size_t)count, sizeof(dgfem_real)) : NULL;
    if (!copy || (shared && !share)) {
        dgfem_mvci_free(&body->hooks, copy);
        dgfem_mvci_free(&body->hooks, share);
        return dgfem_mvci_fail_memory(&body->hooks);
    }
    for (int i = 0; shared && i < count; i++) share[i] = 1;
    dgfem_mvc_condition *condition = &body->conditions[body->condition_count++];
    memset(condition, 0, sizeof *condition);
    condition->id = body->next_id++;
    condition->kind = kind;
    condition->items = copy;
    condition->share = share;
    condition->count = count;
    if (id) *id = condition->id;
    *added = condition;
    return DGFEM_OK;
}

static dgfem_mvc_condition *dgfem_mvci_find_condition(const dgfem_mvc *body, int id) {
    for (int c = 0; c < body->condition_count; c++)
        if (body->conditions[c].id == id) return &body->conditions[c];
    return NULL;
}

/* The condition of this id and, unless `any`, kind. */
static dgfem_status dgfem_mvci_get_condition(const dgfem_mvc *body, int id, dgfem_mvc_condition_kind kind, int any,
                                             dgfem_mvc_condition **out) {
    *out = dgfem_mvci_find_condition(body, id);
    if (!*out) return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_INDEX, "no condition has the id %d", id);
    if (!any && (*out)->kind != kind)
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "condition %d is of another kind", id);
    return DGFEM_OK;
}

/* ---- what holds ---- */

static dgfem_status dgfem_mvci_fix(dgfem_mvc *body, const int *nodes, int count, int axes, int *id,
                                   dgfem_mvc_condition **condition) {
    dgfem_status status = dgfem_mvci_check_items(body, nodes, count, body->node_count, "node");
    if (!status && (axes < 1 || axes > DGFEM_MVC_XYZ))
        status = dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "axes %d, expected 1..7", axes);
    if (!status) status = dgfem_mvci_add_condition(body, DGFEM_MVC_CONDITION_FIX, nodes, count, id, condition);
    if (!status) (*condition)->axes = axes;
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_fix_nodes(dgfem_mvc *body, const int *nodes, int count, int axes,
                                           dgfem_vec3 displacement, int *id) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_check_vector(&body->hooks, displacement, "displacement");
    if (!status) status = dgfem_mvci_fix(body, nodes, count, axes, id, &condition);
    if (!status) condition->vector = displacement;
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_fix_nodes_fn(dgfem_mvc *body, const int *nodes, int count, int axes,
                                              dgfem_displacement_fn fn, void *user, int *id) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!fn) return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "no function");
    dgfem_status status = dgfem_mvci_fix(body, nodes, count, axes, id, &condition);
    if (status) return status;
    condition->fn = fn;
    condition->fn_user = user;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_move_fixture(dgfem_mvc *body, int id, dgfem_mat3 linear, dgfem_vec3 translation) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_get_condition(body, id, DGFEM_MVC_CONDITION_FIX, 0, &condition);
    if (!status) status = dgfem_mvci_check_vector(&body->hooks, translation, "translation");
    for (int i = 0; !status && i < 9; i++) status = dgfem_mvci_check_real(body, linear.m[i / 3][i % 3], "linear");
    if (status) return status;
    condition->linear = linear;
    condition->vector = translation;
    condition->fn = NULL;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_pin(dgfem_mvc *body, int node, dgfem_real stiffness, int *id) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_check_items(body, &node, 1, body->node_count, "node");
    if (!status) status = dgfem_mvci_check_scalar(&body->hooks, stiffness, 0, "stiffness");
    if (!status) status = dgfem_mvci_add_condition(body, DGFEM_MVC_CONDITION_PIN, &node, 1, id, &condition);
    if (status) return status;
    condition->scalar = stiffness;
    condition->vector = body->position[node];
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_drag(dgfem_mvc *body, int id, dgfem_vec3 place) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_get_condition(body, id, DGFEM_MVC_CONDITION_PIN, 0, &condition);
    if (!status) status = dgfem_mvci_check_vector(&body->hooks, place, "place");
    if (!status) condition->vector = place;
    return status;
}

/* ---- what loads ---- */

DGFEM_API dgfem_status dgfem_mvc_set_traction(dgfem_mvc *body, const int *faces, int count, dgfem_vec3 traction,
                                              int *id) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_check_loaded_faces(body, faces, count);
    if (!status) status = dgfem_mvci_check_vector(&body->hooks, traction, "traction");
    if (!status) status = dgfem_mvci_add_condition(body, DGFEM_MVC_CONDITION_TRACTION, faces, count, id, &condition);
    if (!status) condition->vector = traction;
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_set_pressure(dgfem_mvc *body, const int *faces, int count, dgfem_real pressure,
                                              int *id) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_check_loaded_faces(body, faces, count);
    if (!status) status = dgfem_mvci_check_real(body, pressure, "pressure");
    if (!status) status = dgfem_mvci_add_condition(body, DGFEM_MVC_CONDITION_PRESSURE, faces, count, id, &condition);
    if (!status) condition->scalar = pressure;
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_add_force(dgfem_mvc *body, const int *nodes, int count, dgfem_vec3 force, int *id) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_check_items(body, nodes, count, body->node_count, "node");
    if (!status) status = dgfem_mvci_check_vector(&body->hooks, force, "force");
    if (!status) status = dgfem_mvci_add_condition(body, DGFEM_MVC_CONDITION_FORCE, nodes, count, id, &condition);
    if (!status) condition->vector = force;
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_change_load(dgfem_mvc *body, int id, dgfem_vec3 vector, dgfem_real scalar) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_get_condition(body, id, DGFEM_MVC_CONDITION_FORCE, 1, &condition);
    if (!status && (condition->kind == DGFEM_MVC_CONDITION_FIX || condition->kind == DGFEM_MVC_CONDITION_PIN))
        status = dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "condition %d is not a load", id);
    if (!status) status = dgfem_mvci_check_vector(&body->hooks, vector, "load");
    if (!status) status = dgfem_mvci_check_real(body, scalar, "load");
    if (status) return status;
    condition->vector = vector;
    condition->scalar = scalar;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_set_gravity(dgfem_mvc *body, dgfem_vec3 gravity) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_check_vector(&body->hooks, gravity, "gravity");
    if (!status) body->desc.gravity = gravity;
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_remove_condition(dgfem_mvc *body, int id) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_get_condition(body, id, DGFEM_MVC_CONDITION_FIX, 1, &condition);
    if (status) return status;
    dgfem_mvci_free(&body->hooks, condition->items);
    dgfem_mvci_free(&body->hooks, condition->share);
    body->condition_count--;
    memmove(condition, condition + 1,
            (size_t)(body->conditions + body->condition_count - condition) * sizeof *condition);
    return DGFEM_OK;
}

/* ---- contact shapes ---- */

static dgfem_status dgfem_mvci_check_obstacle(const dgfem_mvc *body, dgfem_shape_kind kind,
                                              const dgfem_shape_desc *desc) {
    const dgfem_hooks *hooks = &body->hooks;
    if (!desc || desc->cookie != dgfem_default_shape_desc().cookie) return DGFEM_ERROR_DESCRIPTOR;
    dgfem_status status = dgfem_mvci_check_scalar(hooks, desc->stiffness, 0, "stiffness");
    if (!status) status = dgfem_mvci_check_scalar(hooks, desc->damping, 0, "damping");
    if (!status) status = dgfem_mvci_check_scalar(hooks, desc->friction, 0, "friction");
    if (!status) status = dgfem_mvci_check_scalar(hooks, desc->slip_speed, 1, "slip_speed");
    if (!status) status = dgfem_mvci_check_vector(hooks, desc->velocity, "velocity");
    if (!status) status = dgfem_mvci_check_vector(hooks, desc->centre, "centre");
    if (!status) status = dgfem_mvci_check_vector(hooks, desc->plane.normal, "normal");
    if (!status) status = dgfem_mvci_check_real(body, desc->plane.offset, "offset");
    if (!status) status = dgfem_mvci_check_real(body, desc->radius, "radius");
    if (!status && kind == DGFEM_SHAPE_PLANE && !(dgfem_mvci_norm(desc->plane.normal) > 0))
        status = dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "the plane's normal is zero");
    if (!status && kind == DGFEM_SHAPE_PLANE)
        status = dgfem_mvci_check_real(body, dgfem_mvci_norm(desc->plane.normal), "length of the plane's normal");
    if (!status && kind == DGFEM_SHAPE_SPHERE && desc->radius == 0)
        status = dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "the sphere's radius is 0");
    return status;
}

static dgfem_status dgfem_mvci_add_shape(dgfem_mvc *body, dgfem_shape_kind kind, const dgfem_shape_desc *desc,
                                         int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_check_obstacle(body, kind, desc);
    if (status) return status;
    if (body->shape_count == body->shape_capacity) {
        int capacity = 2 * body->shape_capacity + 4;
        dgfem_shape *grown =
            (dgfem_shape *)dgfem_mvci_reallocate(&body->hooks, body->shapes, (size_t)capacity, sizeof *grown);
        if (!grown) return dgfem_mvci_fail_memory(&body->hooks);
        body->shapes = grown;
        body->shape_capacity = capacity;
    }
    dgfem_shape *shape = &body->shapes[body->shape_count++];
    memset(shape, 0, sizeof *shape);
    shape->id = body->next_id++;
    shape->kind = kind;
    shape->desc = *desc;
    if (id) *id = shape->id;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_add_plane(dgfem_mvc *body, const dgfem_shape_desc *desc, int *id) {
    return dgfem_mvci_add_shape(body, DGFEM_SHAPE_PLANE, desc, id);
}

DGFEM_API dgfem_status dgfem_mvc_add_sphere(dgfem_mvc *body, const dgfem_shape_desc *desc, int *id) {
    return dgfem_mvci_add_shape(body, DGFEM_SHAPE_SPHERE, desc, id);
}

DGFEM_API dgfem_status dgfem_mvc_move_shape(dgfem_mvc *body, int id, const dgfem_shape_desc *desc) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    for (int s = 0; s < body->shape_count; s++) {
        if (body->shapes[s].id != id) continue;
        dgfem_status status = dgfem_mvci_check_obstacle(body, body->shapes[s].kind, desc);
        if (!status) body->shapes[s].desc = *desc;
        return status;
    }
    return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_INDEX, "no shape has the id %d", id);
}
