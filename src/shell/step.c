#pragma once
#include "static.c"
/* Implicit Euler: one step solves, for the velocities v at its end,
     (1 + h alpha) M v + h (f_int(x + h v) + f_damp - F_ext - F_contact) = M v0,   x+ = x + h v,
   by Newton's method. Stiffness damping f_damp is the force of the stresses beta C (strain+ - strain) / h, about
   beta K v. Contact acts at the nodes. */

/* ---- contact ----

   A node at signed distance d of a shape, direction n, has the depth g = thickness / 2 - d. With its spring
   k = stiffness * E * thickness and relative velocity w
     f = n (k g - c n.w) - c_t (I - n n^T) w,  c = damping k,  c_t = friction * normal force / max(slip, slip speed).
   Friction follows the normal force at the beginning of the step. */

typedef struct dgfem_shelli_touch {
    dgfem_vec3 normal, relative;
    dgfem_real depth, spring, tangential;
} dgfem_shelli_touch;

/* 1 where node i, at x with velocity v, presses against the shape. */
static int dgfem_shelli_touches(const dgfem_shell *shell, const dgfem_shape *shape, int i, dgfem_vec3 x, dgfem_vec3 v,
                                dgfem_shelli_touch *touch) {
    const dgfem_shape_desc *desc = &shape->desc;
    dgfem_vec3 before;
    touch->depth = shell->node_half[i] - dgfem_shape_distance(shape, x, &touch->normal);
    touch->relative = dgfem_shelli_sub(v, desc->velocity);
    touch->spring = desc->stiffness * shell->node_spring[i];
    touch->tangential = 0;
    dgfem_real speed = dgfem_shelli_dot(touch->normal, touch->relative);
    if (!(touch->depth > 0) || !(touch->depth - desc->damping * speed > 0)) return 0;
    dgfem_real depth = shell->node_half[i] - dgfem_shape_distance(shape, shell->position[i], &before);
    if (!(depth > 0)) return 1;
    dgfem_vec3 slide = dgfem_shelli_axpy(touch->relative, -speed, touch->normal);
    touch->tangential =
        desc->friction * touch->spring * depth / dgfem_shelli_max(dgfem_shelli_norm(slide), desc->slip_speed);
    return 1;
}

/* out += factor * contact forces at x with velocities v. Returns the number of nodes that touch. */
static int dgfem_shelli_add_contact(const dgfem_shell *shell, const dgfem_vec3 *x, const dgfem_vec3 *v,
                                    dgfem_real factor, dgfem_vec3 *out) {
    int count = 0;
    for (int i = 0; shell->shape_count && i < shell->node_count; i++) {
        int touching = 0;
        for (int s = 0; s < shell->shape_count; s++) {
            dgfem_shelli_touch touch;
            if (!dgfem_shelli_touches(shell, &shell->shapes[s], i, x[i], v[i], &touch)) continue;
            dgfem_real speed = dgfem_shelli_dot(touch.normal, touch.relative);
            dgfem_real push = touch.spring * (touch.depth - shell->shapes[s].desc.damping * speed);
            push += touch.tangential * speed;
            out[i] = dgfem_shelli_axpy(out[i], factor * push, touch.normal);
            out[i] = dgfem_shelli_axpy(out[i], -factor * touch.tangential, touch.relative);
            touching = 1;
        }
        count += touching;
    }
    return count;
}

/* matrix += minus the derivative of h F_contact by v, for x = x0 + h v. */
static void dgfem_shelli_assemble_contact(const dgfem_shell *shell, const dgfem_vec3 *x, const dgfem_vec3 *v,
                                          dgfem_real h) {
    for (int i = 0; shell->shape_count && i < shell->node_count; i++)
        for (int s = 0; s < shell->shape_count; s++) {
            dgfem_shelli_touch touch;
            if (!dgfem_shelli_touches(shell, &shell->shapes[s], i, x[i], v[i], &touch)) continue;
            dgfem_real *block = shell->system->matrix->values + shell->system->diagonal[i];
            dgfem_real normal = h * touch.spring * (h + shell->shapes[s].desc.damping);
            dgfem_mat3 m;
            memcpy(&m, block, sizeof m);
            dgfem_shelli_add_outer(&m, normal - h * touch.tangential, touch.normal, touch.normal);
            for (int k = 0; k < 3; k++) m.m[k][k] += h * touch.tangential;
            memcpy(block, &m, sizeof m);
        }
}

/* ---- mass ---- */

/* out += factor * M v */
static void dgfem_shelli_add_momentum(const dgfem_shell *shell, dgfem_real factor, const dgfem_vec3 *v,
                                      dgfem_vec3 *out) {
    if (!shell->desc.consistent_mass) {
        for (int i = 0; i < shell->node_count; i++)
            out[i] = dgfem_shelli_axpy(out[i], factor * shell->node_mass[i], v[i]);
        return;
    }
    for (int e = 0; e < shell->element_count; e++) {
        const dgfem_shell_element *element = &shell->elements[e];
        dgfem_vec3 x[DGFEM_SHELL_MAX_NODES], w[DGFEM_SHELL_MAX_NODES];
        int n = element->node_count;
        dgfem_real density = factor * element->thickness * element->material.density;
        dgfem_shelli_gather(shell->rest, element->node, n, x);
        dgfem_shelli_gather(v, element->node, n, w);
        for (int q = 0; q < dgfem_shelli_fine_count(n); q++) {
            const dgfem_shelli_basis *f = dgfem_shelli_fine_basis(shell->system, n, q);
            dgfem_vec3 flow =
                dgfem_shelli_scale(density * dgfem_shelli_fine_area(f, x, n, q), dgfem_shelli_sum(f->n, w, n));
            for (int a = 0; a < n; a++) out[element->node[a]] = dgfem_shelli_axpy(out[element->node[a]], f->n[a], flow);
        }
    }
}

/* matrix += factor * M */
static void dgfem_shelli_assemble_mass(const dgfem_shell *shell, dgfem_real factor) {
    const dgfem_shell_system *system = shell->system;
    dgfem_real *values = system->matrix->values;
    for (int i = 0; !shell->desc.consistent_mass && i < shell->node_count; i++)
        for (int k = 0; k < 9; k += 4) values[system->diagonal[i] + (size_t)k] += factor * shell->node_mass[i];
    for (int e = 0; shell->desc.consistent_mass && e < shell->element_count; e++) {
        const dgfem_shell_element *element = &shell->elements[e];
        const size_t *map = system->map + system->groups[e].map_start;
        dgfem_vec3 x[DGFEM_SHELL_MAX_NODES];
        int n = element->node_count;
        dgfem_real density = factor * element->thickness * element->material.density;
        dgfem_shelli_gather(shell->rest, element->node, n, x);
        for (int q = 0; q < dgfem_shelli_fine_count(n); q++) {
            const dgfem_shelli_basis *f = dgfem_shelli_fine_basis(system, n, q);
            dgfem_real weight = density * dgfem_shelli_fine_area(f, x, n, q);
            const size_t *to = map;
            for (int a = 0; a < n; a++)
                for (int b = 0; b <= a; b++, to++)
                    for (size_t k = 0; k < 9; k += 4) values[*to + k] += weight * f->n[a] * f->n[b];
        }
    }
}

/* ---- one step ---- */

/* Velocities of held directions: those that reach their targets. */
static void dgfem_shelli_hold_velocities(const dgfem_shell *shell, dgfem_real h, dgfem_vec3 *v) {
    const dgfem_shell_system *system = shell->system;
    for (int i = 0; i < shell->node_count; i++) {
        if (!system->held[i]) continue;
        dgfem_vec3 wanted = dgfem_shelli_sub(dgfem_shelli_add(shell->rest[i], system->target[i]), shell->position[i]);
        wanted = dgfem_shelli_scale(1 / h, wanted);
        wanted = dgfem_shelli_sub(wanted, dgfem_shelli_multiply(&system->free_part[i], wanted));
        v[i] = dgfem_shelli_add(dgfem_shelli_multiply(&system->free_part[i], v[i]), wanted);
    }
}

/* Positions and residual of velocities v; sets the scale of the momenta that balance, which does not depend on how fast
   the frame moves. Returns the nodes in contact. */
static int dgfem_shelli_step_residual(const dgfem_shell *shell, dgfem_real h, const dgfem_vec3 *v, dgfem_vec3 *x,
                                      dgfem_vec3 *r, dgfem_real *scale) {
    dgfem_vec3 *force = dgfem_shelli_vector(shell, DGFEM_SHELLI_FORCE);
    dgfem_vec3 *gain = dgfem_shelli_vector(shell, DGFEM_SHELLI_MOTION);
    dgfem_vec3 *momentum = dgfem_shelli_vector(shell, DGFEM_SHELLI_RHS);
    for (int i = 0; i < shell->node_count; i++) x[i] = dgfem_shelli_axpy(shell->position[i], h, v[i]);
    for (int i = 0; i < shell->node_count; i++) gain[i] = dgfem_shelli_sub(v[i], shell->velocity[i]);
    memset(force, 0, dgfem_shelli_bytes(shell));
    memset(momentum, 0, dgfem_shelli_bytes(shell));
    memset(r, 0, dgfem_shelli_bytes(shell));
    dgfem_shelli_add_external(shell, x, !shell->desc.consistent_mass, h, force);
    int contacts = dgfem_shelli_add_contact(shell, x, v, h, force);
    (void)dgfem_shelli_add_internal(shell, x, shell->desc.damping_stiffness / h, h, r);
    dgfem_shelli_add_momentum(shell, 1, gain, momentum);
    *scale = dgfem_shelli_max(dgfem_shelli_length(shell, force), dgfem_shelli_length(shell, r));
    *scale = dgfem_shelli_max(*scale, dgfem_shelli_length(shell, momentum));
    dgfem_shelli_add_momentum(shell, h * shell->desc.damping_mass, v, momentum);
    for (int i = 0; i < shell->node_count; i++) r[i] = dgfem_shelli_sub(dgfem_shelli_sub(force[i], r[i]), momentum[i]);
    dgfem_shelli_hold_vector(shell, r);
    return contacts;
}

/* Round-off of the momenta that balance: of h f_int by that of positions, and of M v. Where nothing acts, as in free
   flight, no residual is smaller. */
static dgfem_real dgfem_shelli_step_floor(const dgfem_shell *shell, dgfem_real h, const dgfem_vec3 *x,
                                          const dgfem_vec3 *v, dgfem_real extent) {
    dgfem_real size = h * shell->system->stiffness * dgfem_shelli_reach(shell, x, extent), square = 0;
    for (int i = 0; i < shell->node_count; i++) {
        dgfem_real mass = dgfem_shelli_max(shell->node_mass[i], shell->node_load[i]);
        square += mass * mass * (dgfem_shelli_dot(v[i], v[i]));
    }
    return 4 * DGFEM_SHELL_EPSILON * (size + dgfem_shelli_sqrt(square));
}

/* Matrix of a step: (1 + h alpha) M + h^2 K + h beta K_frozen, loads and contact. Loads that make it indefinite are
   left out with the rest of the tangent where `spins` is 0. */
static void dgfem_shelli_assemble_step(const dgfem_shell *shell, dgfem_real h, const dgfem_vec3 *x, const dgfem_vec3 *v,
                                       int spins) {
    dgfem_matrix_clear(shell->system->matrix);
    dgfem_shelli_assemble(shell, x, spins, 1 + shell->desc.damping_stiffness / h, h * h);
    shell->system->stiffness =
        dgfem_shelli_shift_diagonal(shell, 0) / (h * h * (1 + shell->desc.damping_stiffness / h));
    dgfem_shelli_assemble_external(shell, x, spins, h * h);
    dgfem_shelli_assemble_mass(shell, 1 + h * shell->desc.damping_mass);
    dgfem_shelli_assemble_contact(shell, x, v, h);
    dgfem_shelli_hold_matrix(shell);
}

/* Factors the matrix of a step. Where a buckling shell makes it indefinite, more and more mass is added, as if the step
   were shorter, and at last rotations are frozen. */
static dgfem_status dgfem_shelli_factor_step(dgfem_shell *shell, dgfem_real h, const dgfem_vec3 *x, const dgfem_vec3 *v,
                                             dgfem_shell_info *info) {
    double start = dgfem_shelli_clock(&shell->hooks);
    dgfem_real mass = 1;
    dgfem_shelli_assemble_step(shell, h, x, v, shell->desc.corotational);
    info->seconds_assemble += dgfem_shelli_clock(&shell->hooks) - start;
    dgfem_status status = dgfem_shelli_factor(shell, info);
    for (int k = 0; k < 5 && status == DGFEM_ERROR_NOT_POSITIVE_DEFINITE; k++, mass *= 4) {
        dgfem_shelli_assemble_mass(shell, mass);
        dgfem_shelli_hold_matrix(shell);
        info->shifts++;
        status = dgfem_shelli_factor(shell, info);
    }
    if (status != DGFEM_ERROR_NOT_POSITIVE_DEFINITE) return status;
    dgfem_shelli_assemble_step(shell, h, x, v, 0);
    return dgfem_shelli_factor_shifted(shell, info);
}

/* One Newton iteration: v += A^-1 r. */
static dgfem_status dgfem_shelli_step_solve(dgfem_shell *shell, dgfem_real h, const dgfem_vec3 *x, dgfem_vec3 *v,
                                            int frozen, dgfem_shell_info *info) {
    dgfem_vec3 *r = dgfem_shelli_vector(shell, DGFEM_SHELLI_RESIDUAL);
    dgfem_vec3 *solution = dgfem_shelli_vector(shell, DGFEM_SHELLI_SOLUTION);
    dgfem_status status;
    if (frozen) {
        dgfem_shelli_assemble_step(shell, h, x, v, 0);
        status = dgfem_shelli_factor_shifted(shell, info);
    } else {
        status = dgfem_shelli_factor_step(shell, h, x, v, info);
    }
    if (!status) status = dgfem_shelli_solve(shell, r, solution, info);
    if (status) return status;
    dgfem_shelli_hold_vector(shell, solution);
    for (int i = 0; i < shell->node_count; i++) v[i] = dgfem_shelli_add(v[i], solution[i]);
    return DGFEM_OK;
}

/* The step where Newton's method got nowhere: semi-implicit, with rotations and contacts of its beginning. */
static dgfem_status dgfem_shelli_step_frozen(dgfem_shell *shell, dgfem_real h, dgfem_shell_info *info) {
    dgfem_vec3 *x = dgfem_shelli_vector(shell, DGFEM_SHELLI_X), *v = dgfem_shelli_vector(shell, DGFEM_SHELLI_V);
    dgfem_vec3 *r = dgfem_shelli_vector(shell, DGFEM_SHELLI_RESIDUAL);
    dgfem_real scale;
    memset(v, 0, dgfem_shelli_bytes(shell));
    dgfem_shelli_hold_velocities(shell, h, v);
    (void)dgfem_shelli_step_residual(shell, h, v, x, r, &scale);
    dgfem_status status = dgfem_shelli_step_solve(shell, h, x, v, 1, info);
    if (status) return status;
    info->iterations++;
    info->contacts = dgfem_shelli_step_residual(shell, h, v, x, r, &scale);
    dgfem_real residual = dgfem_shelli_length(shell, r);
    info->residual = scale > 0 ? residual / scale : 0;
    return dgfem_shelli_is_finite(residual) ? DGFEM_OK : DGFEM_ERROR_NOT_FINITE;
}

static dgfem_status dgfem_shelli_step(dgfem_shell *shell, dgfem_real h, dgfem_shell_info *info) {
    const dgfem_real lost = DGFEM_R(0.1); /* a residual that is as good as none */
    dgfem_vec3 *x = dgfem_shelli_vector(shell, DGFEM_SHELLI_X), *v = dgfem_shelli_vector(shell, DGFEM_SHELLI_V);
    dgfem_vec3 *r = dgfem_shelli_vector(shell, DGFEM_SHELLI_RESIDUAL);
    dgfem_real scale, extent = dgfem_shelli_extent(shell);
    (void)dgfem_shelli_collect_held(shell);
    if (shell->desc.damping_stiffness > 0) dgfem_shelli_keep_strains(shell);
    memcpy(v, shell->velocity, dgfem_shelli_bytes(shell));
    dgfem_shelli_hold_velocities(shell, h, v);
    info->contacts = dgfem_shelli_step_residual(shell, h, v, x, r, &scale);
    for (;;) {
        dgfem_status status = dgfem_shelli_step_solve(shell, h, x, v, 0, info);
        if (status) return status;
        info->iterations++;
        info->contacts = dgfem_shelli_step_residual(shell, h, v, x, r, &scale);
        dgfem_real residual = dgfem_shelli_length(shell, r);
        info->residual = scale > 0 ? residual / scale : 0;
        if (residual <= shell->desc.step_tolerance * scale) break;
        if (residual <= dgfem_shelli_step_floor(shell, h, x, v, extent)) break;
        if (info->iterations >= shell->desc.step_iterations || !dgfem_shelli_is_finite(residual))
            return residual <= lost * scale ? DGFEM_OK : dgfem_shelli_step_frozen(shell, h, info);
        if (!shell->desc.corotational && !shell->shape_count) break;
    }
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_step(dgfem_shell *shell, dgfem_real dt, dgfem_shell_info *info) {
    dgfem_shell_info local = dgfem_shelli_empty_info();
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_scalar(&shell->hooks, dt, 1, "dt");
    if (status) return status;
    status = dgfem_shelli_step(shell, dt, &local);
    if (info) *info = local;
    if (status)
        return dgfem_shelli_fail(&shell->hooks, status, "step: %d iterations, residual %g, node %d", local.iterations,
                                 (double)local.residual, local.failed_node);
    memcpy(shell->position, dgfem_shelli_vector(shell, DGFEM_SHELLI_X), dgfem_shelli_bytes(shell));
    memcpy(shell->velocity, dgfem_shelli_vector(shell, DGFEM_SHELLI_V), dgfem_shelli_bytes(shell));
    dgfem_shelli_settle(shell);
    shell->time += (double)dt;
    return DGFEM_OK;
}
