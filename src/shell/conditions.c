#pragma once
#include "system.c"
/* What holds and loads a shell: the list of conditions and contact shapes. */

static dgfem_status dgfem_shelli_check_items(const dgfem_shell *shell, const int *items, int count, int limit,
                                             const char *what) {
    if (count < 1 || !items)
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "condition on %d %ss", count, what);
    for (int i = 0; i < count; i++)
        if (items[i] < 0 || items[i] >= limit)
            return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_INDEX, "%s %d of %d", what, items[i], limit);
    return DGFEM_OK;
}

static dgfem_status dgfem_shelli_check_boundary(const dgfem_shell *shell, const int *edges, int count, int support) {
    dgfem_status status = dgfem_shelli_check_items(shell, edges, count, shell->edge_count, "edge");
    for (int i = 0; !status && i < count; i++) {
        const dgfem_shell_edge *edge = &shell->edges[edges[i]];
        if (!dgfem_shelli_is_boundary(edge))
            status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "edge %d is not on the boundary", edges[i]);
        else if (support && edge->support != DGFEM_NONE)
            status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "edge %d is held by condition %d already",
                                       edges[i], shell->conditions[edge->support].id);
    }
    return status;
}

static dgfem_status dgfem_shelli_check_vector(const dgfem_shell *shell, dgfem_vec3 v, const char *what) {
    if (dgfem_shelli_is_finite3(v)) return DGFEM_OK;
    return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_NOT_FINITE, "%s (%g, %g, %g)", what, (double)v.x, (double)v.y,
                             (double)v.z);
}

static dgfem_status dgfem_shelli_check_real(const dgfem_shell *shell, dgfem_real x, const char *what) {
    if (dgfem_shelli_is_finite(x)) return DGFEM_OK;
    return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_NOT_FINITE, "%s %g", what, (double)x);
}

/* Every part of the path is reached: the next one begins here. */
static void dgfem_shelli_settle(dgfem_shell *shell) {
    for (int c = 0; c < shell->condition_count; c++) {
        dgfem_shell_condition *condition = &shell->conditions[c];
        condition->vector_before = condition->vector;
        condition->scalar_before = condition->scalar;
        condition->rotation_before = condition->rotation;
    }
    shell->gravity_before = shell->desc.gravity;
}

/* What condition number c says about its edges. */
static void dgfem_shelli_mark_edges(dgfem_shell *shell, int c) {
    const dgfem_shell_condition *condition = &shell->conditions[c];
    for (int i = 0; i < condition->count; i++) {
        if (condition->kind == DGFEM_SHELL_CONDITION_MOMENT) {
            dgfem_shell_edge *edge = &shell->edges[condition->items[i]];
            *(condition->follower ? &edge->follower_moment : &edge->moment) +=
                dgfem_shelli_scalar_now(shell, condition);
        } else if (condition->kind == DGFEM_SHELL_CONDITION_CLAMP ||
                   condition->kind == DGFEM_SHELL_CONDITION_SYMMETRY ||
                   condition->kind == DGFEM_SHELL_CONDITION_ROTATION) {
            shell->edges[condition->items[i]].support = c;
        }
    }
}

/* What all conditions say. */
static void dgfem_shelli_refresh_edges(dgfem_shell *shell) {
    for (int i = 0; i < shell->edge_count; i++) {
        shell->edges[i].support = DGFEM_NONE;
        shell->edges[i].moment = shell->edges[i].follower_moment = 0;
    }
    for (int c = 0; c < shell->condition_count; c++) dgfem_shelli_mark_edges(shell, c);
}

/* Appends a condition of checked items; the caller fills in the rest of *added. */
static dgfem_status dgfem_shelli_add_condition(dgfem_shell *shell, dgfem_shell_condition_kind kind, const int *items,
                                               int count, int *id, dgfem_shell_condition **added) {
    if (shell->condition_count == shell->condition_capacity) {
        int capacity = 2 * shell->condition_capacity + 8;
        dgfem_shell_condition *grown = (dgfem_shell_condition *)dgfem_shelli_reallocate(
            &shell->hooks, shell->conditions, (size_t)capacity, sizeof *grown);
        if (!grown) return dgfem_shelli_fail_memory(&shell->hooks);
        shell->conditions = grown;
        shell->condition_capacity = capacity;
    }
    int *copy = (int *)dgfem_shelli_duplicate(&shell->hooks, items, (size_t)count, sizeof(int));
    if (!copy) return dgfem_shelli_fail_memory(&shell->hooks);
    dgfem_shell_condition *condition = &shell->conditions[shell->condition_count++];
    memset(condition, 0, sizeof *condition);
    condition->id = shell->next_id++;
    condition->kind = kind;
    condition->items = copy;
    condition->count = count;
    condition->rotation = condition->rotation_before = dgfem_shelli_identity();
    if (id) *id = condition->id;
    *added = condition;
    return DGFEM_OK;
}

static dgfem_shell_condition *dgfem_shelli_find_condition(dgfem_shell *shell, int id) {
    for (int c = 0; c < shell->condition_count; c++)
        if (shell->conditions[c].id == id) return &shell->conditions[c];
    return NULL;
}

/* The condition of this id and, unless `any`, kind. */
static dgfem_status dgfem_shelli_get_condition(dgfem_shell *shell, int id, dgfem_shell_condition_kind kind, int any,
                                               dgfem_shell_condition **out) {
    *out = dgfem_shelli_find_condition(shell, id);
    if (!*out) return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_INDEX, "no condition has the id %d", id);
    if (!any && (*out)->kind != kind)
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "condition %d is of another kind", id);
    return DGFEM_OK;
}

/* ---- what holds ---- */

DGFEM_API dgfem_status dgfem_shell_fix_nodes(dgfem_shell *shell, const int *nodes, int count, int axes,
                                             dgfem_vec3 displacement, int *id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_items(shell, nodes, count, shell->node_count, "node");
    if (!status) status = dgfem_shelli_check_vector(shell, displacement, "displacement");
    if (!status && (axes < 1 || axes > DGFEM_SHELL_XYZ))
        status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "axes %d, expected 1..7", axes);
    if (!status) status = dgfem_shelli_add_condition(shell, DGFEM_SHELL_CONDITION_FIX, nodes, count, id, &condition);
    if (status) return status;
    condition->axes = axes;
    condition->vector = displacement;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_fix_symmetry(dgfem_shell *shell, const int *edges, int count, dgfem_vec3 normal,
                                                int *id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_boundary(shell, edges, count, 1);
    if (!status) status = dgfem_shelli_check_vector(shell, normal, "normal");
    if (!status && !(dgfem_shelli_norm(normal) > 0))
        status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "the normal is zero");
    if (!status)
        status = dgfem_shelli_add_condition(shell, DGFEM_SHELL_CONDITION_SYMMETRY, edges, count, id, &condition);
    if (status) return status;
    condition->vector = dgfem_shelli_unit(normal);
    dgfem_shelli_mark_edges(shell, shell->condition_count - 1);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_clamp(dgfem_shell *shell, const int *edges, int count, int *id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_boundary(shell, edges, count, 1);
    if (!status) status = dgfem_shelli_add_condition(shell, DGFEM_SHELL_CONDITION_CLAMP, edges, count, id, &condition);
    if (!status) dgfem_shelli_mark_edges(shell, shell->condition_count - 1);
    return status;
}

DGFEM_API dgfem_status dgfem_shell_fix_rotation(dgfem_shell *shell, const int *edges, int count, dgfem_real angle,
                                                int *id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_boundary(shell, edges, count, 1);
    if (!status) status = dgfem_shelli_check_real(shell, angle, "angle");
    if (!status)
        status = dgfem_shelli_add_condition(shell, DGFEM_SHELL_CONDITION_ROTATION, edges, count, id, &condition);
    if (status) return status;
    condition->scalar = angle;
    dgfem_shelli_mark_edges(shell, shell->condition_count - 1);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_move_fixture(dgfem_shell *shell, int id, dgfem_vec3 displacement) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_get_condition(shell, id, DGFEM_SHELL_CONDITION_FIX, 0, &condition);
    if (!status) status = dgfem_shelli_check_vector(shell, displacement, "displacement");
    if (!status) condition->vector = displacement;
    return status;
}

DGFEM_API dgfem_status dgfem_shell_move_clamp(dgfem_shell *shell, int id, dgfem_mat3 rotation, dgfem_vec3 translation) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_get_condition(shell, id, DGFEM_SHELL_CONDITION_CLAMP, 0, &condition);
    if (!status) status = dgfem_shelli_check_vector(shell, translation, "translation");
    if (status) return status;
    dgfem_mat3 transposed = dgfem_shelli_transposed(&rotation), unit = dgfem_shelli_multiply3(&transposed, &rotation);
    dgfem_real error = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) error += dgfem_shelli_abs(unit.m[i][j] - (dgfem_real)(i == j));
    if (!(error < DGFEM_R(1e-4)))
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "condition %d: not a rotation", id);
    if (!(dgfem_shelli_determinant(&rotation) > 0))
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "condition %d: a reflection, not a rotation", id);
    condition->rotation = rotation;
    condition->vector = translation;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_turn_edges(dgfem_shell *shell, int id, dgfem_real angle) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_get_condition(shell, id, DGFEM_SHELL_CONDITION_ROTATION, 0, &condition);
    if (!status) status = dgfem_shelli_check_real(shell, angle, "angle");
    if (!status) condition->scalar = angle;
    return status;
}

/* ---- what loads ---- */

DGFEM_API dgfem_status dgfem_shell_set_moment(dgfem_shell *shell, const int *edges, int count, dgfem_real moment,
                                              int follower, int *id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_boundary(shell, edges, count, 0);
    if (!status) status = dgfem_shelli_check_real(shell, moment, "moment");
    if (!status) status = dgfem_shelli_add_condition(shell, DGFEM_SHELL_CONDITION_MOMENT, edges, count, id, &condition);
    if (status) return status;
    condition->scalar = moment;
    condition->follower = follower != 0;
    dgfem_shelli_mark_edges(shell, shell->condition_count - 1);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_set_line_load(dgfem_shell *shell, const int *edges, int count, dgfem_vec3 load,
                                                 int *id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_items(shell, edges, count, shell->edge_count, "edge");
    if (!status) status = dgfem_shelli_check_vector(shell, load, "load");
    if (!status)
        status = dgfem_shelli_add_condition(shell, DGFEM_SHELL_CONDITION_LINE_LOAD, edges, count, id, &condition);
    if (!status) condition->vector = load;
    return status;
}

/* Appends a pressure; without a list of elements, on all. */
static dgfem_status dgfem_shelli_add_pressure(dgfem_shell *shell, const int *elements, int count, int *id,
                                              dgfem_shell_condition **condition) {
    dgfem_shelli_scratch scratch = dgfem_shelli_scratch_make(&shell->hooks);
    dgfem_status status = DGFEM_OK;
    if (!elements) {
        int *all = (int *)dgfem_shelli_take(&scratch, (size_t)shell->element_count, sizeof(int));
        for (int e = 0; all && e < shell->element_count; e++) all[e] = e;
        elements = all;
        count = shell->element_count;
        if (!all) status = dgfem_shelli_fail_memory(&shell->hooks);
    }
    if (!status) status = dgfem_shelli_check_items(shell, elements, count, shell->element_count, "element");
    if (!status)
        status = dgfem_shelli_add_condition(shell, DGFEM_SHELL_CONDITION_PRESSURE, elements, count, id, condition);
    dgfem_shelli_scratch_free(&scratch);
    return status;
}

DGFEM_API dgfem_status dgfem_shell_set_pressure(dgfem_shell *shell, const int *elements, int count, dgfem_real pressure,
                                                int follower, int *id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_real(shell, pressure, "pressure");
    if (!status) status = dgfem_shelli_add_pressure(shell, elements, count, id, &condition);
    if (status) return status;
    condition->scalar = pressure;
    condition->follower = follower != 0;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_add_force(dgfem_shell *shell, const int *nodes, int count, dgfem_vec3 force,
                                             int *id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_items(shell, nodes, count, shell->node_count, "node");
    if (!status) status = dgfem_shelli_check_vector(shell, force, "force");
    if (!status) status = dgfem_shelli_add_condition(shell, DGFEM_SHELL_CONDITION_FORCE, nodes, count, id, &condition);
    if (!status) condition->vector = force;
    return status;
}

DGFEM_API dgfem_status dgfem_shell_pin(dgfem_shell *shell, int node, dgfem_real stiffness, int *id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_items(shell, &node, 1, shell->node_count, "node");
    if (!status) status = dgfem_shelli_check_scalar(&shell->hooks, stiffness, 0, "stiffness");
    if (!status) status = dgfem_shelli_add_condition(shell, DGFEM_SHELL_CONDITION_PIN, &node, 1, id, &condition);
    if (status) return status;
    condition->scalar = stiffness;
    condition->vector = condition->vector_before = shell->position[node];
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_drag(dgfem_shell *shell, int id, dgfem_vec3 place) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_get_condition(shell, id, DGFEM_SHELL_CONDITION_PIN, 0, &condition);
    if (!status) status = dgfem_shelli_check_vector(shell, place, "place");
    if (!status) condition->vector = place;
    return status;
}

DGFEM_API dgfem_status dgfem_shell_change_load(dgfem_shell *shell, int id, dgfem_vec3 vector, dgfem_real scalar) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_get_condition(shell, id, DGFEM_SHELL_CONDITION_FORCE, 1, &condition);
    if (!status && condition->kind != DGFEM_SHELL_CONDITION_FORCE && condition->kind != DGFEM_SHELL_CONDITION_MOMENT &&
        condition->kind != DGFEM_SHELL_CONDITION_LINE_LOAD && condition->kind != DGFEM_SHELL_CONDITION_PRESSURE)
        status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "condition %d is not a load", id);
    if (!status) status = dgfem_shelli_check_vector(shell, vector, "load");
    if (!status) status = dgfem_shelli_check_real(shell, scalar, "load");
    if (status) return status;
    condition->vector = vector;
    condition->scalar = scalar;
    dgfem_shelli_refresh_edges(shell);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_set_gravity(dgfem_shell *shell, dgfem_vec3 gravity) {
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_vector(shell, gravity, "gravity");
    if (!status) shell->desc.gravity = gravity;
    return status;
}

DGFEM_API dgfem_status dgfem_shell_remove_condition(dgfem_shell *shell, int id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_get_condition(shell, id, DGFEM_SHELL_CONDITION_FIX, 1, &condition);
    if (status) return status;
    dgfem_shelli_free(&shell->hooks, condition->items);
    shell->condition_count--;
    memmove(condition, condition + 1,
            (size_t)(shell->conditions + shell->condition_count - condition) * sizeof *condition);
    dgfem_shelli_refresh_edges(shell);
    return DGFEM_OK;
}

/* ---- contact shapes ---- */

static dgfem_status dgfem_shelli_check_shape(const dgfem_shell *shell, dgfem_shape_kind kind,
                                             const dgfem_shape_desc *desc) {
    const dgfem_hooks *hooks = &shell->hooks;
    if (!desc || desc->cookie != dgfem_default_shape_desc().cookie) return DGFEM_ERROR_DESCRIPTOR;
    dgfem_status status = dgfem_shelli_check_scalar(hooks, desc->stiffness, 0, "stiffness");
    if (!status) status = dgfem_shelli_check_scalar(hooks, desc->damping, 0, "damping");
    if (!status) status = dgfem_shelli_check_scalar(hooks, desc->friction, 0, "friction");
    if (!status) status = dgfem_shelli_check_scalar(hooks, desc->slip_speed, 1, "slip_speed");
    if (!status) status = dgfem_shelli_check_vector(shell, desc->velocity, "velocity");
    if (!status) status = dgfem_shelli_check_vector(shell, desc->centre, "centre");
    if (!status) status = dgfem_shelli_check_vector(shell, desc->plane.normal, "normal");
    if (!status) status = dgfem_shelli_check_real(shell, desc->plane.offset, "offset");
    if (!status) status = dgfem_shelli_check_real(shell, desc->radius, "radius");
    if (!status && kind == DGFEM_SHAPE_PLANE && !(dgfem_shelli_norm(desc->plane.normal) > 0))
        status = dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "the plane's normal is zero");
    if (!status && kind == DGFEM_SHAPE_SPHERE && desc->radius == 0)
        status = dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "the sphere's radius is 0");
    return status;
}

static dgfem_status dgfem_shelli_add_shape(dgfem_shell *shell, dgfem_shape_kind kind, const dgfem_shape_desc *desc,
                                           int *id) {
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_shape(shell, kind, desc);
    if (status) return status;
    if (shell->shape_count == shell->shape_capacity) {
        int capacity = 2 * shell->shape_capacity + 4;
        dgfem_shape *grown =
            (dgfem_shape *)dgfem_shelli_reallocate(&shell->hooks, shell->shapes, (size_t)capacity, sizeof *grown);
        if (!grown) return dgfem_shelli_fail_memory(&shell->hooks);
        shell->shapes = grown;
        shell->shape_capacity = capacity;
    }
    dgfem_shape *shape = &shell->shapes[shell->shape_count++];
    memset(shape, 0, sizeof *shape);
    shape->id = shell->next_id++;
    shape->kind = kind;
    shape->desc = *desc;
    if (id) *id = shape->id;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_add_plane(dgfem_shell *shell, const dgfem_shape_desc *desc, int *id) {
    return dgfem_shelli_add_shape(shell, DGFEM_SHAPE_PLANE, desc, id);
}

DGFEM_API dgfem_status dgfem_shell_add_sphere(dgfem_shell *shell, const dgfem_shape_desc *desc, int *id) {
    return dgfem_shelli_add_shape(shell, DGFEM_SHAPE_SPHERE, desc, id);
}

/* Position of the shape of this id in the list, or DGFEM_NONE; that has its line in the log. */
static int dgfem_shelli_find_shape(const dgfem_shell *shell, int id) {
    for (int s = 0; s < shell->shape_count; s++)
        if (shell->shapes[s].id == id) return s;
    (void)dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_INDEX, "no shape has the id %d", id);
    return DGFEM_NONE;
}

DGFEM_API dgfem_status dgfem_shell_move_shape(dgfem_shell *shell, int id, const dgfem_shape_desc *desc) {
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    int s = dgfem_shelli_find_shape(shell, id);
    if (s == DGFEM_NONE) return DGFEM_ERROR_INDEX;
    dgfem_status status = dgfem_shelli_check_shape(shell, shell->shapes[s].kind, desc);
    if (!status) shell->shapes[s].desc = *desc;
    return status;
}

DGFEM_API dgfem_status dgfem_shell_remove_shape(dgfem_shell *shell, int id) {
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    int s = dgfem_shelli_find_shape(shell, id);
    if (s == DGFEM_NONE) return DGFEM_ERROR_INDEX;
    memmove(shell->shapes + s, shell->shapes + s + 1, (size_t)(--shell->shape_count - s) * sizeof *shell->shapes);
    return DGFEM_OK;
}
