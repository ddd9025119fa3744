#pragma once
#include "warp.c"
/* External forces, contact, held nodes. */

static int dgfem_mvci_is_face_load(const dgfem_mvc_condition *condition) {
    return condition->kind == DGFEM_MVC_CONDITION_TRACTION || condition->kind == DGFEM_MVC_CONDITION_PRESSURE;
}

/* A displacement that is linear on triangles takes a third of each triangle's load at each of its nodes: exactly for
   uniform tractions, and for pressure on the current, flat triangles. */
static void dgfem_mvci_add_face_load(const dgfem_mvc *body, const dgfem_mvc_condition *condition, dgfem_real factor,
                                     dgfem_vec3 *out) {
    for (int k = 0; k < condition->count; k++) {
        int count;
        const int *at = dgfem_mvci_face_triangles(body->mesh, condition->items[k], &count);
        for (int t = 0; t < count; t++, at += 3) {
            dgfem_vec3 load;
            if (condition->kind == DGFEM_MVC_CONDITION_PRESSURE)
                load = dgfem_mvci_scale(-condition->scalar / 6, dgfem_mvci_loop_area(body->position, at, 3));
            else
                load =
                    dgfem_mvci_scale(dgfem_mvci_norm(dgfem_mvci_loop_area(body->rest, at, 3)) / 6, condition->vector);
            for (int i = 0; i < 3; i++) out[at[i]] = dgfem_mvci_axpy(out[at[i]], factor, load);
        }
    }
}

/* out += factor * (gravity and loads); pins are apart. */
static void dgfem_mvci_add_external(const dgfem_mvc *body, dgfem_real factor, dgfem_vec3 *out) {
    for (int i = 0; i < body->node_count; i++)
        out[i] = dgfem_mvci_axpy(out[i], factor * body->mass[i], body->desc.gravity);
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_mvc_condition *condition = &body->conditions[c];
        if (dgfem_mvci_is_face_load(condition)) dgfem_mvci_add_face_load(body, condition, factor, out);
        if (condition->kind != DGFEM_MVC_CONDITION_FORCE) continue;
        for (int i = 0; i < condition->count; i++) {
            dgfem_vec3 *to = &out[condition->items[i]];
            *to = dgfem_mvci_axpy(*to, factor * condition->share[i], condition->vector);
        }
    }
}

/* Adds the springs of all pins, times `stiffness`, to the matrix, and their force, times `force`, to rhs. */
static void dgfem_mvci_assemble_pins(const dgfem_mvc *body, dgfem_real stiffness, dgfem_real force, dgfem_vec3 *rhs) {
    const dgfem_mvc_system *system = body->system;
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_mvc_condition *pin = &body->conditions[c];
        for (int i = 0; pin->kind == DGFEM_MVC_CONDITION_PIN && i < pin->count; i++) {
            int node = pin->items[i];
            dgfem_real spring = pin->scalar * pin->share[i], *block = system->matrix->values + system->diagonal[node];
            for (int k = 0; k < 9; k += 4) block[k] += stiffness * spring;
            rhs[node] = dgfem_mvci_axpy(rhs[node], force * spring, dgfem_mvci_sub(pin->vector, body->position[node]));
        }
    }
}

/* ---- contact ---- */

typedef struct dgfem_mvci_contact {
    dgfem_vec3 normal;
    dgfem_real depth; /* at the beginning of the step */
} dgfem_mvci_contact;

/* Whether the node presses against the shape at the end of the step, moving on as it does: one that leaves is not held
   back, one that arrives (depth < 0) is stopped at the surface. Below the surface gravity counts with what it will add,
   and damping acts: without gravity a body at rest would hop by g h^2 forever. Above it must not count: a foot that
   something else wants to lift would be glued to the ground. */
static int dgfem_mvci_contact_is_active(const dgfem_shape *shape, dgfem_vec3 x, dgfem_vec3 v, dgfem_vec3 gravity,
                                        dgfem_real h, dgfem_mvci_contact *contact) {
    dgfem_vec3 relative = dgfem_mvci_sub(v, shape->desc.velocity);
    dgfem_real delay = h;
    contact->depth = -dgfem_shape_distance(shape, x, &contact->normal);
    if (contact->depth > 0) {
        relative = dgfem_mvci_axpy(relative, h, gravity);
        delay += shape->desc.damping;
    }
    return contact->depth - delay * dgfem_mvci_dot(contact->normal, relative) > 0;
}

/* Adds an active contact of stiffness k: block v+ = ... + g. Friction follows the normal force that the last step has
   left, k depth and its damping: a node that has just arrived feels it one step later, when what stopped it is known.
   */
static void dgfem_mvci_add_contact(const dgfem_shape *shape, const dgfem_mvci_contact *contact, dgfem_vec3 v,
                                   dgfem_real k, dgfem_real h, dgfem_real *block, dgfem_vec3 *g) {
    const dgfem_shape_desc *desc = &shape->desc;
    dgfem_vec3 n = contact->normal, relative = dgfem_mvci_sub(v, desc->velocity);
    dgfem_real speed = dgfem_mvci_dot(n, relative), normal = h * h * k, tangential = 0;
    if (contact->depth > 0) {
        dgfem_real force = k * (contact->depth - desc->damping * speed);
        dgfem_real slip = dgfem_mvci_norm(dgfem_mvci_axpy(relative, -speed, n));
        normal += h * desc->damping * k;
        if (force > 0) tangential = h * desc->friction * force / dgfem_mvci_max(slip, desc->slip_speed);
    }
    for (int i = 0; i < 9; i += 4) block[i] += tangential;
    dgfem_mvci_add_block(block, normal - tangential, n, n);
    speed = dgfem_mvci_dot(n, desc->velocity);
    *g = dgfem_mvci_axpy(*g, tangential, desc->velocity);
    *g = dgfem_mvci_axpy(*g, h * k * contact->depth + (normal - tangential) * speed, n);
}

/* Contact of all boundary nodes, each with its part of the surface: pressure = stiffness (E / radius) depth. Returns
   the number of nodes that touch. */
static int dgfem_mvci_assemble_contact(const dgfem_mvc *body, dgfem_real h, dgfem_vec3 *rhs) {
    const dgfem_mvc_system *system = body->system;
    int count = 0;
    for (int i = 0; body->shape_count && i < body->node_count; i++) {
        int touching = 0;
        if (!(body->area[i] > 0)) continue;
        for (int s = 0; s < body->shape_count; s++) {
            const dgfem_shape *shape = &body->shapes[s];
            dgfem_mvci_contact contact;
            if (!dgfem_mvci_contact_is_active(shape, body->position[i], body->velocity[i], body->desc.gravity, h,
                                              &contact))
                continue;
            dgfem_mvci_add_contact(shape, &contact, body->velocity[i],
                                   shape->desc.stiffness * body->modulus[i] * body->area[i], h,
                                   system->matrix->values + system->diagonal[i], &rhs[i]);
            touching = 1;
        }
        count += touching;
    }
    return count;
}

/* ---- held nodes ---- */

/* Target displacements, times factor, and axes of all held nodes. */
static dgfem_status dgfem_mvci_collect_held(const dgfem_mvc *body, dgfem_real factor) {
    char *held = body->system->held;
    dgfem_vec3 *target = dgfem_mvci_vector(body, DGFEM_MVCI_TARGET);
    memset(held, 0, (size_t)body->node_count);
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_mvc_condition *condition = &body->conditions[c];
        for (int i = 0; condition->kind == DGFEM_MVC_CONDITION_FIX && i < condition->count; i++) {
            int node = condition->items[i];
            dgfem_vec3 u = dgfem_mvci_add(dgfem_mvci_multiply(&condition->linear, body->rest[node]), condition->vector);
            if (condition->fn) condition->fn(condition->fn_user, body->rest[node], &u);
            if (!dgfem_mvci_is_finite3(u))
                return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "displacement of node %d (condition %d)",
                                       node, condition->id);
            if (condition->axes & DGFEM_MVC_X) target[node].x = factor * u.x;
            if (condition->axes & DGFEM_MVC_Y) target[node].y = factor * u.y;
            if (condition->axes & DGFEM_MVC_Z) target[node].z = factor * u.z;
            held[node] = (char)(held[node] | condition->axes);
        }
    }
    return DGFEM_OK;
}

/* Writes to x, at held axes, what leads in time h from the current positions to the targets. */
static void dgfem_mvci_hold_vector(const dgfem_mvc *body, dgfem_real h, dgfem_vec3 *x) {
    const dgfem_vec3 *target = dgfem_mvci_vector(body, DGFEM_MVCI_TARGET);
    for (int i = 0; i < body->node_count; i++) {
        int axes = body->system->held[i];
        dgfem_vec3 way = dgfem_mvci_sub(dgfem_mvci_add(body->rest[i], target[i]), body->position[i]);
        if (axes & DGFEM_MVC_X) x[i].x = way.x / h;
        if (axes & DGFEM_MVC_Y) x[i].y = way.y / h;
        if (axes & DGFEM_MVC_Z) x[i].z = way.z / h;
    }
}

/* Moves the columns of held axes, whose unknowns stand in x, to the right-hand side, and makes their rows the identity
   times the size of the diagonal. */
static void dgfem_mvci_hold_matrix(const dgfem_mvc *body, const dgfem_vec3 *x, dgfem_vec3 *rhs) {
    const dgfem_mvc_system *system = body->system;
    const dgfem_matrix *matrix = system->matrix;
    const dgfem_real *known = (const dgfem_real *)(const void *)x;
    dgfem_real *b = dgfem_mvci_reals(rhs);
    for (int r = 0; r < matrix->block_count; r++)
        for (int k = matrix->row_start[r]; k < matrix->row_start[r + 1]; k++) {
            int c = matrix->column[k];
            dgfem_real *block = matrix->values + matrix->value_start[k];
            dgfem_real size = (block[0] + block[4] + block[8]) / 3;
            if (!system->held[r] && !system->held[c]) continue;
            for (int i = 0; i < 9; i++) {
                int row_held = system->held[r] >> (i / 3) & 1, column_held = system->held[c] >> (i % 3) & 1;
                if (column_held && !row_held) b[3 * r + i / 3] -= block[i] * known[3 * c + i % 3];
                if (r != c && row_held && !column_held) b[3 * c + i % 3] -= block[i] * known[3 * r + i / 3];
                if (!row_held && !column_held) continue;
                block[i] = r == c && i % 4 == 0 ? size : 0;
                if (r == c && i % 4 == 0) b[3 * r + i / 3] = size * known[3 * r + i / 3];
            }
        }
}
