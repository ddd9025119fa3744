#pragma once
#include "body.c"
/* What acts on a solid: conditions (held faces and elements, pins, loads), contact shapes and points. */

/* ---- the list of conditions ---- */

static dgfem_condition *dgfemi_find_condition(const dgfem_body *body, int id) {
    for (int i = 0; i < body->condition_count; i++)
        if (body->conditions[i].id == id) return &body->conditions[i];
    return NULL;
}

/* The condition with this id, if it is of this kind; else NULL and a log line. */
static dgfem_condition *dgfemi_expect_condition(const dgfem_body *body, int id, dgfem_condition_kind kind) {
    dgfem_condition *condition = dgfemi_find_condition(body, id);
    if (condition && condition->kind == kind) return condition;
    (void)dgfemi_fail(&body->hooks, DGFEM_ERROR_INDEX, "there is no condition of that kind with the id %d", id);
    return NULL;
}

static dgfem_status dgfemi_check_items(const dgfem_body *body, const int *items, int count, int limit,
                                       const char *what) {
    if (!items || count < 1) return dgfemi_fail(&body->hooks, DGFEM_ERROR_EMPTY, "condition on %d %ss", count, what);
    for (int i = 0; i < count; i++)
        if (items[i] < 0 || items[i] >= limit)
            return dgfemi_fail(&body->hooks, DGFEM_ERROR_INDEX, "%s %d, expected 0..%d", what, items[i], limit - 1);
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_elements(const dgfem_body *body, const int *elements, int count) {
    return dgfemi_check_items(body, elements, count, body->mesh->element_count, "element");
}

static dgfem_status dgfemi_check_boundary_faces(const dgfem_body *body, const int *faces, int count) {
    dgfem_status status = dgfemi_check_items(body, faces, count, body->mesh->face_count, "face");
    for (int i = 0; !status && i < count; i++)
        if (body->mesh->faces[faces[i]].element[1] != DGFEM_NONE)
            status = dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "face %d lies between two elements", faces[i]);
    return status;
}

static dgfem_status dgfemi_check_finite(const dgfem_body *body, dgfem_vec3 v, const char *what) {
    if (dgfemi_is_finite3(v)) return DGFEM_OK;
    return dgfemi_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "%s (%g, %g, %g)", what, (double)v.x, (double)v.y,
                       (double)v.z);
}

/* Room for one more condition, with a copy of its items: the last place of the list, not yet counted. NULL when out of
   memory. */
static dgfem_condition *dgfemi_reserve_condition(dgfem_body *body, dgfem_condition_kind kind, const int *items,
                                                 int count) {
    if (body->condition_count == body->condition_capacity) {
        void *grown = dgfemi_grow(&body->hooks, body->conditions, &body->condition_capacity, body->condition_count + 1,
                                  sizeof *body->conditions);
        if (!grown) return NULL;
        body->conditions = (dgfem_condition *)grown;
    }
    dgfem_condition *condition = &body->conditions[body->condition_count];
    memset(condition, 0, sizeof *condition);
    condition->id = body->next_id;
    condition->kind = kind;
    condition->count = count;
    condition->items = (int *)dgfemi_duplicate(&body->hooks, items, (size_t)count, sizeof(int));
    return condition->items ? condition : NULL;
}

/* Counts the condition reserved last. */
static dgfem_status dgfemi_accept_condition(dgfem_body *body, int *id) {
    if (id) *id = body->next_id;
    body->condition_count++;
    body->next_id++;
    return DGFEM_OK;
}

/* ---- held faces ---- */

static dgfem_status dgfemi_check_free_faces(const dgfem_body *body, const int *faces, int count) {
    dgfem_status status = dgfemi_check_boundary_faces(body, faces, count);
    if (status) return status;
    char *held = (char *)dgfemi_allocate_zero(&body->hooks, (size_t)body->mesh->face_count, 1);
    if (!held) return dgfemi_fail_memory(&body->hooks);
    for (int f = 0; f < body->forms->face_count; f++) held[body->forms->faces[f].face] = 1;
    for (int i = 0; !status && i < count; i++) {
        if (held[faces[i]])
            status = dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "face %d is held already", faces[i]);
        held[faces[i]] = 1;
    }
    dgfemi_free(&body->hooks, held);
    return status;
}

static void dgfemi_set_constant_ghosts(dgfem_body *body, const dgfem_condition *condition) {
    for (int f = 0; f < body->forms->face_count; f++) {
        const dgfemi_face_form *form = &body->forms->faces[f];
        if (form->condition != condition->id) continue;
        dgfem_vec3 *ghost = dgfemi_form_ghost(body->forms, form);
        memset(ghost, 0, (size_t)form->count[1] * sizeof *ghost);
        ghost[0] = condition->vector;
    }
}

/* Samples the prescribed displacement on the faces of a condition: all of them change, or on failure none. */
static dgfem_status dgfemi_sample_ghosts(dgfem_body *body, const dgfem_condition *condition) {
    dgfem_vec3 *fits =
        (dgfem_vec3 *)dgfemi_allocate(&body->hooks, (size_t)condition->count, DGFEM_MAX_BASIS * sizeof(dgfem_vec3));
    dgfem_status status = fits ? DGFEM_OK : dgfemi_fail_memory(&body->hooks);
    for (int pass = 0; pass < 2; pass++) {
        dgfem_vec3 *fit = fits;
        for (int f = 0; !status && f < body->forms->face_count; f++) {
            const dgfemi_face_form *form = &body->forms->faces[f];
            if (form->condition != condition->id) continue;
            if (pass == 0) status = dgfemi_fit_ghost(body, form, condition->fn, condition->fn_user, fit);
            else memcpy(dgfemi_form_ghost(body->forms, form), fit, (size_t)form->count[1] * sizeof *fit);
            fit += form->count[1];
        }
    }
    dgfemi_free(&body->hooks, fits);
    return status;
}

/* Adds the face forms of the condition reserved last, all or none, and counts it. */
static dgfem_status dgfemi_hold_faces(dgfem_body *body, dgfem_condition *condition, int *id) {
    dgfem_status status = DGFEM_OK;
    int normal_only = condition->kind == DGFEM_CONDITION_FIX_NORMAL;
    for (int i = 0; !status && i < condition->count; i++)
        if (dgfemi_forms_add_face(body, body->forms, condition->items[i], condition->id, normal_only) == DGFEM_NONE)
            status = dgfemi_fail_memory(&body->hooks);
    if (!status && condition->fn) status = dgfemi_sample_ghosts(body, condition);
    else if (!status) dgfemi_set_constant_ghosts(body, condition);
    if (!status) return dgfemi_accept_condition(body, id);
    dgfemi_forms_remove_condition(body->forms, &body->hooks, condition->id);
    dgfemi_condition_free(&body->hooks, condition);
    return status;
}

static dgfem_status dgfemi_fix_faces(dgfem_body *body, dgfem_condition_kind kind, const int *faces, int count,
                                     dgfem_vec3 displacement, dgfem_displacement_fn fn, void *user, int *id) {
    dgfem_status status = dgfemi_check_free_faces(body, faces, count);
    if (status) return status;
    dgfem_condition *condition = dgfemi_reserve_condition(body, kind, faces, count);
    if (!condition) return dgfemi_fail_memory(&body->hooks);
    condition->vector = displacement;
    condition->fn = fn;
    condition->fn_user = user;
    return dgfemi_hold_faces(body, condition, id);
}

DGFEM_API dgfem_status dgfem_body_fix_faces(dgfem_body *body, const int *faces, int face_count, dgfem_vec3 displacement,
                                            int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_finite(body, displacement, "fix_faces: displacement");
    if (status) return status;
    return dgfemi_fix_faces(body, DGFEM_CONDITION_FIX_FACES, faces, face_count, displacement, NULL, NULL, id);
}

DGFEM_API dgfem_status dgfem_body_fix_faces_fn(dgfem_body *body, const int *faces, int face_count,
                                               dgfem_displacement_fn fn, void *user, int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!fn) return dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "fix_faces_fn: no function");
    return dgfemi_fix_faces(body, DGFEM_CONDITION_FIX_FACES, faces, face_count, dgfemi_vec3(0, 0, 0), fn, user, id);
}

DGFEM_API dgfem_status dgfem_body_fix_normal(dgfem_body *body, const int *faces, int face_count, int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    return dgfemi_fix_faces(body, DGFEM_CONDITION_FIX_NORMAL, faces, face_count, dgfemi_vec3(0, 0, 0), NULL, NULL, id);
}

DGFEM_API dgfem_status dgfem_body_move_fixture(dgfem_body *body, int id, dgfem_vec3 displacement) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_finite(body, displacement, "move_fixture: displacement");
    if (status) return status;
    dgfem_condition *condition = dgfemi_expect_condition(body, id, DGFEM_CONDITION_FIX_FACES);
    if (!condition) return DGFEM_ERROR_INDEX;
    condition->vector = displacement;
    condition->fn = NULL;
    dgfemi_set_constant_ghosts(body, condition);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_body_resample_fixture(dgfem_body *body, int id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_condition *condition = dgfemi_expect_condition(body, id, DGFEM_CONDITION_FIX_FACES);
    if (!condition) return DGFEM_ERROR_INDEX;
    return condition->fn ? dgfemi_sample_ghosts(body, condition) : DGFEM_OK;
}

/* ---- held elements ---- */

static dgfem_status dgfemi_check_free_elements(const dgfem_body *body, const int *elements, int count) {
    dgfem_status status = dgfemi_check_elements(body, elements, count);
    if (status) return status;
    char *held = (char *)dgfemi_allocate_zero(&body->hooks, (size_t)body->mesh->element_count, 1);
    if (!held) return dgfemi_fail_memory(&body->hooks);
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_condition *condition = &body->conditions[c];
        if (condition->kind != DGFEM_CONDITION_FIX_ELEMENTS) continue;
        for (int i = 0; i < condition->count; i++) held[condition->items[i]] = 1;
    }
    for (int i = 0; !status && i < count; i++) {
        if (held[elements[i]])
            status = dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "element %d is held already", elements[i]);
        held[elements[i]] = 1;
    }
    dgfemi_free(&body->hooks, held);
    return status;
}

static int dgfemi_element_basis(const dgfem_body *body, int element) {
    return body->basis_start[element + 1] - body->basis_start[element];
}

DGFEM_API dgfem_status dgfem_body_fix_elements(dgfem_body *body, const int *elements, int element_count, int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_free_elements(body, elements, element_count);
    if (status) return status;
    size_t values = 0;
    dgfem_condition *condition = dgfemi_reserve_condition(body, DGFEM_CONDITION_FIX_ELEMENTS, elements, element_count);
    if (!condition) return dgfemi_fail_memory(&body->hooks);
    for (int i = 0; i < element_count; i++) values += (size_t)dgfemi_element_basis(body, elements[i]);
    condition->values = (dgfem_vec3 *)dgfemi_allocate(&body->hooks, values, sizeof(dgfem_vec3));
    if (!condition->values) {
        dgfemi_condition_free(&body->hooks, condition);
        return dgfemi_fail_memory(&body->hooks);
    }
    dgfem_vec3 *value = condition->values;
    for (int i = 0; i < element_count; i++)
        for (int k = body->basis_start[elements[i]]; k < body->basis_start[elements[i] + 1]; k++)
            *value++ = body->displacement[k];
    return dgfemi_accept_condition(body, id);
}

DGFEM_API dgfem_status dgfem_body_move_elements(dgfem_body *body, int id, dgfem_mat3 linear, dgfem_vec3 translation) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_affine(body, &linear, translation);
    if (status) return status;
    dgfem_condition *condition = dgfemi_expect_condition(body, id, DGFEM_CONDITION_FIX_ELEMENTS);
    if (!condition) return DGFEM_ERROR_INDEX;
    dgfem_vec3 *values = condition->values;
    for (int i = 0; i < condition->count; i++) {
        dgfemi_affine_element(body, condition->items[i], &linear, translation, values);
        values += dgfemi_element_basis(body, condition->items[i]);
    }
    return DGFEM_OK;
}

/* ---- forces ---- */

/* out_i += weights_i v over the functions of an element */
static void dgfemi_add_weighted(const dgfem_body *body, int element, const dgfem_real *weights, dgfem_vec3 v,
                                dgfem_vec3 *out) {
    int first = body->basis_start[element];
    for (int i = first; i < body->basis_start[element + 1]; i++)
        out[i] = dgfemi_add_scaled(out[i], weights[i - first], v);
}

static void dgfemi_add_traction(const dgfem_body *body, int face, dgfem_vec3 traction, dgfem_vec3 *force) {
    dgfem_real moments[DGFEM_MAX_MOMENTS];
    int e = body->mesh->faces[face].element[0];
    dgfemi_mesh_face_moments(body->mesh, face, body->degree[e], body->origin[e], body->scale[e], moments);
    dgfemi_add_weighted(body, e, moments, traction, force);
}

static void dgfemi_add_body_force(const dgfem_body *body, int element, dgfem_vec3 density, dgfem_vec3 *force) {
    dgfemi_add_weighted(body, element, dgfemi_form_load(body->forms, element), density, force);
}

static void dgfemi_add_point_force(const dgfem_body *body, int element, dgfem_vec3 rest, dgfem_vec3 point_force,
                                   dgfem_vec3 *force) {
    dgfem_real n[DGFEM_MAX_BASIS];
    dgfemi_basis_evaluate(body->degree[element], body->origin[element], body->scale[element], rest, n);
    dgfemi_add_weighted(body, element, n, point_force, force);
}

/* Adds a condition's load to the body's force, if it is one that does not depend on the state. */
static void dgfemi_add_dead_load(dgfem_body *body, const dgfem_condition *condition) {
    for (int i = 0; i < condition->count; i++) {
        int item = condition->items[i];
        if (condition->kind == DGFEM_CONDITION_TRACTION)
            dgfemi_add_traction(body, item, condition->vector, body->force);
        else if (condition->kind == DGFEM_CONDITION_BODY_FORCE)
            dgfemi_add_body_force(body, item, condition->vector, body->force);
        else if (condition->kind == DGFEM_CONDITION_FORCE)
            dgfemi_add_point_force(body, item, condition->point, condition->vector, body->force);
    }
}

/* Sums those loads anew: subtracting one would leave round-off. */
static void dgfemi_update_force(dgfem_body *body) {
    memset(body->force, 0, (size_t)body->basis_count * sizeof *body->force);
    for (int c = 0; c < body->condition_count; c++) dgfemi_add_dead_load(body, &body->conditions[c]);
}

/* out = gravity, dead loads and pressure, times `factor`. Pressure acts along normals turned with their elements. */
static void dgfemi_external_force(const dgfem_body *body, const dgfem_mat3 *rotation, dgfem_real factor,
                                  dgfem_vec3 *out) {
    for (int i = 0; i < body->basis_count; i++) out[i] = dgfemi_scale(factor, body->force[i]);
    for (int e = 0; e < body->mesh->element_count; e++)
        dgfemi_add_body_force(body, e, dgfemi_scale(factor * body->material[e].density, body->desc.gravity), out);
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_condition *condition = &body->conditions[c];
        for (int i = 0; condition->kind == DGFEM_CONDITION_PRESSURE && i < condition->count; i++) {
            const dgfem_face *face = &body->mesh->faces[condition->items[i]];
            dgfem_vec3 normal = dgfemi_multiply(&rotation[face->element[0]], face->normal);
            dgfemi_add_traction(body, condition->items[i], dgfemi_scale(-factor * condition->scalar, normal), out);
        }
    }
}

/* A load without further data than its items, a vector, a number and a point. */
static dgfem_status dgfemi_add_load(dgfem_body *body, dgfem_condition_kind kind, const int *items, int count,
                                    dgfem_vec3 vector, dgfem_real scalar, dgfem_vec3 point, int *id) {
    dgfem_condition *condition = dgfemi_reserve_condition(body, kind, items, count);
    if (!condition) return dgfemi_fail_memory(&body->hooks);
    condition->vector = vector;
    condition->scalar = scalar;
    condition->point = point;
    dgfemi_add_dead_load(body, condition);
    return dgfemi_accept_condition(body, id);
}

DGFEM_API dgfem_status dgfem_body_set_traction(dgfem_body *body, const int *faces, int face_count, dgfem_vec3 traction,
                                               int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_boundary_faces(body, faces, face_count);
    if (!status) status = dgfemi_check_finite(body, traction, "traction");
    if (status) return status;
    return dgfemi_add_load(body, DGFEM_CONDITION_TRACTION, faces, face_count, traction, 0, dgfemi_vec3(0, 0, 0), id);
}

DGFEM_API dgfem_status dgfem_body_set_pressure(dgfem_body *body, const int *faces, int face_count, dgfem_real pressure,
                                               int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_vec3 none = dgfemi_vec3(0, 0, 0);
    dgfem_status status = dgfemi_check_boundary_faces(body, faces, face_count);
    if (!status) status = dgfemi_check_finite(body, dgfemi_vec3(pressure, 0, 0), "pressure");
    if (status) return status;
    return dgfemi_add_load(body, DGFEM_CONDITION_PRESSURE, faces, face_count, none, pressure, none, id);
}

DGFEM_API dgfem_status dgfem_body_set_body_force(dgfem_body *body, const int *elements, int element_count,
                                                 dgfem_vec3 density, int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_elements(body, elements, element_count);
    if (!status) status = dgfemi_check_finite(body, density, "body force");
    if (status) return status;
    return dgfemi_add_load(body, DGFEM_CONDITION_BODY_FORCE, elements, element_count, density, 0, dgfemi_vec3(0, 0, 0),
                           id);
}

DGFEM_API dgfem_status dgfem_body_add_force(dgfem_body *body, int element, dgfem_vec3 rest, dgfem_vec3 force, int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_elements(body, &element, 1);
    if (!status) status = dgfemi_check_finite(body, rest, "force: rest position");
    if (!status) status = dgfemi_check_finite(body, force, "force");
    if (status) return status;
    return dgfemi_add_load(body, DGFEM_CONDITION_FORCE, &element, 1, force, 0, rest, id);
}

/* ---- pins ---- */

DGFEM_API dgfem_status dgfem_body_pin(dgfem_body *body, int element, dgfem_vec3 rest, dgfem_real stiffness, int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_elements(body, &element, 1);
    if (!status) status = dgfemi_check_finite(body, rest, "pin: rest position");
    if (!status) status = dgfemi_check_positive(&body->hooks, stiffness, "pin: stiffness");
    if (status) return status;
    dgfem_vec3 place = dgfemi_add(rest, dgfemi_evaluate(body, body->displacement, element, rest));
    return dgfemi_add_load(body, DGFEM_CONDITION_PIN, &element, 1, place, stiffness, rest, id);
}

DGFEM_API dgfem_status dgfem_body_drag(dgfem_body *body, int id, dgfem_vec3 place) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_finite(body, place, "drag: place");
    if (status) return status;
    dgfem_condition *condition = dgfemi_expect_condition(body, id, DGFEM_CONDITION_PIN);
    if (!condition) return DGFEM_ERROR_INDEX;
    condition->vector = place;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_body_remove_condition(dgfem_body *body, int id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_condition *condition = dgfemi_find_condition(body, id);
    if (!condition) return dgfemi_fail(&body->hooks, DGFEM_ERROR_INDEX, "there is no condition with the id %d", id);
    dgfemi_forms_remove_condition(body->forms, &body->hooks, id);
    dgfemi_condition_free(&body->hooks, condition);
    for (body->condition_count--; condition < body->conditions + body->condition_count; condition++)
        *condition = condition[1];
    dgfemi_update_force(body);
    return DGFEM_OK;
}

/* ---- contact shapes ---- */

static dgfem_status dgfemi_check_shape(const dgfem_body *body, const dgfem_shape_desc *desc, dgfem_shape_kind kind) {
    const dgfem_hooks *hooks = &body->hooks;
    dgfem_status status = dgfemi_check_not_negative(hooks, desc->damping, "shape: damping");
    if (!status) status = dgfemi_check_not_negative(hooks, desc->friction, "shape: friction");
    if (!status) status = dgfemi_check_positive(hooks, desc->stiffness, "shape: stiffness");
    if (!status) status = dgfemi_check_positive(hooks, desc->slip_speed, "shape: slip_speed");
    if (status) return status;
    if (!dgfemi_is_finite3(desc->velocity)) return dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "shape: velocity");
    if (kind == DGFEM_SHAPE_PLANE) {
        if (!dgfemi_is_finite3(desc->plane.normal) || !dgfemi_is_finite(desc->plane.offset))
            return dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "shape: plane");
        if (!(dgfemi_norm(desc->plane.normal) > 0))
            return dgfemi_fail(hooks, DGFEM_ERROR_DEGENERATE, "shape: the plane's normal is zero");
        return DGFEM_OK;
    }
    if (!dgfemi_is_finite3(desc->centre) || !dgfemi_is_finite(desc->radius))
        return dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "shape: sphere");
    if (desc->radius == 0) return dgfemi_fail(hooks, DGFEM_ERROR_DEGENERATE, "shape: the sphere's radius is zero");
    return DGFEM_OK;
}

/* The desc with a plane of unit normal. */
static dgfem_shape_desc dgfemi_normalized_shape(const dgfem_shape_desc *desc) {
    dgfem_shape_desc result = *desc;
    dgfem_real length = dgfemi_norm(desc->plane.normal);
    if (length > 0) {
        result.plane.normal = dgfemi_normalized(desc->plane.normal);
        result.plane.offset /= length;
    }
    return result;
}

static dgfem_status dgfemi_body_need_contacts(dgfem_body *body) {
    return body->contacts ? DGFEM_OK : dgfemi_contacts_create(body, NULL, NULL, &body->contacts);
}

static dgfem_status dgfemi_add_shape(dgfem_body *body, const dgfem_shape_desc *desc, dgfem_shape_kind kind, int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_desc(&body->hooks, desc, desc ? desc->cookie : 0, "shape");
    if (!status) status = dgfemi_check_shape(body, desc, kind);
    if (!status) status = dgfemi_body_need_contacts(body);
    if (status) return status;
    if (body->shape_count == body->shape_capacity) {
        void *grown =
            dgfemi_grow(&body->hooks, body->shapes, &body->shape_capacity, body->shape_count + 1, sizeof *body->shapes);
        if (!grown) return dgfemi_fail_memory(&body->hooks);
        body->shapes = (dgfem_shape *)grown;
    }
    dgfem_shape *shape = &body->shapes[body->shape_count++];
    shape->id = body->next_id++;
    shape->kind = kind;
    shape->desc = dgfemi_normalized_shape(desc);
    if (id) *id = shape->id;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_body_add_plane(dgfem_body *body, const dgfem_shape_desc *desc, int *id) {
    return dgfemi_add_shape(body, desc, DGFEM_SHAPE_PLANE, id);
}

DGFEM_API dgfem_status dgfem_body_add_sphere(dgfem_body *body, const dgfem_shape_desc *desc, int *id) {
    return dgfemi_add_shape(body, desc, DGFEM_SHAPE_SPHERE, id);
}

DGFEM_API dgfem_status dgfem_body_move_shape(dgfem_body *body, int id, const dgfem_shape_desc *desc) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_desc(&body->hooks, desc, desc ? desc->cookie : 0, "shape");
    if (status) return status;
    for (int i = 0; i < body->shape_count; i++) {
        if (body->shapes[i].id != id) continue;
        status = dgfemi_check_shape(body, desc, body->shapes[i].kind);
        if (!status) body->shapes[i].desc = dgfemi_normalized_shape(desc);
        return status;
    }
    return dgfemi_fail(&body->hooks, DGFEM_ERROR_INDEX, "there is no shape with the id %d", id);
}

DGFEM_API dgfem_status dgfem_body_set_contact_points(dgfem_body *body, dgfem_points_in points,
                                                     const dgfem_real *areas) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_contacts *contacts = NULL;
    dgfem_status status =
        dgfemi_check_points(&body->hooks, points.data, points.type, points.stride, points.count, "contact points");
    if (!status && points.count > 0 && !areas)
        status = dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "contact points: no areas");
    for (int i = 0; !status && i < points.count; i++) {
        if (!dgfemi_is_finite3(dgfemi_point_read(&points, i)))
            status = dgfemi_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "contact point %d", i);
        else if (!(areas[i] >= 0) || !dgfemi_is_finite(areas[i]))
            status = dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "contact point %d: area %g, expected >= 0", i,
                                 (double)areas[i]);
    }
    if (status) return status;
    status = points.count ? dgfemi_contacts_create(body, &points, areas, &contacts)
                          : dgfemi_contacts_create(body, NULL, NULL, &contacts);
    if (status) return status;
    dgfemi_contacts_destroy(body->contacts);
    body->contacts = contacts;
    return DGFEM_OK;
}
