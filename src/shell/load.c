#pragma once
#include "conditions.c"
/* External forces, their derivatives, and the directions in which nodes are held. */

/* ---- forces ---- */

/* Whether a load turns with the shell: without rotations to follow there is only rest to act on. */
static int dgfem_shelli_follows(const dgfem_shell *shell, const dgfem_shell_condition *condition) {
    return condition->follower && shell->desc.corotational;
}

/* What pressure p at a point does: p n dA on its nodes, n dA that of rest or of now. */
static dgfem_vec3 dgfem_shelli_pressure(const dgfem_shell *shell, const dgfem_shelli_group *group,
                                        const dgfem_shelli_point *point, const dgfem_shelli_local *local, int q,
                                        int follower, dgfem_vec3 *e1, dgfem_vec3 *e2) {
    int nodes = shell->elements[group->owner].node_count;
    dgfem_real weight;
    if (!follower) return dgfem_shelli_scale(point->weight, point->t);
    (void)dgfem_shelli_quadrature(nodes, q, &weight);
    dgfem_shelli_side_bases(group, &shell->system->basis[point->basis[0]], 0, nodes, local, e1, e2);
    *e1 = dgfem_shelli_scale(weight, *e1);
    return dgfem_shelli_cross(*e1, *e2);
}

/* Groups of elements come first, in the order of the elements. */
static const dgfem_shelli_group *dgfem_shelli_element_group(const dgfem_shell *shell, int element) {
    return &shell->system->groups[element];
}

static void dgfem_shelli_add_pressure_force(const dgfem_shell *shell, const dgfem_shell_condition *condition,
                                            const dgfem_vec3 *x, dgfem_real factor, dgfem_vec3 *out) {
    dgfem_real pressure = factor * dgfem_shelli_scalar_now(shell, condition);
    int follower = dgfem_shelli_follows(shell, condition);
    for (int i = 0; i < condition->count; i++) {
        const dgfem_shelli_group *group = dgfem_shelli_element_group(shell, condition->items[i]);
        dgfem_shelli_local local;
        dgfem_vec3 e1, e2;
        dgfem_shelli_local_take(shell, group, x, &local);
        for (int q = 0; q < group->point_count; q++) {
            const dgfem_shelli_point *point = &shell->system->points[group->point_start + q];
            const dgfem_real *n = shell->system->basis[point->basis[0]].n;
            dgfem_vec3 push = dgfem_shelli_pressure(shell, group, point, &local, q, follower, &e1, &e2);
            for (int a = 0; a < local.count; a++)
                out[local.nodes[a]] = dgfem_shelli_axpy(out[local.nodes[a]], pressure * n[a], push);
        }
    }
}

/* Integrals over a line of N of its start, end and middle are in the ratio of Simpson's weights on straight edges; on
   curved ones three Gauss points give them. */
static void dgfem_shelli_add_line_load(const dgfem_shell *shell, const dgfem_shell_condition *condition,
                                       dgfem_real factor, dgfem_vec3 *out) {
    dgfem_vec3 load = dgfem_shelli_vector_now(shell, condition);
    for (int i = 0; i < condition->count; i++) {
        const int *node = shell->edges[condition->items[i]].node;
        for (int q = 0; q < DGFEM_SHELLI_EDGE_POINTS; q++) {
            dgfem_real s = dgfem_shelli_gauss_point(q);
            dgfem_real n[3], d[3];
            n[0] = s * (s - 1) / 2, n[1] = s * (s + 1) / 2, n[2] = 1 - s * s;
            d[0] = s - DGFEM_R(0.5), d[1] = s + DGFEM_R(0.5), d[2] = -2 * s;
            dgfem_vec3 tangent = dgfem_shelli_scale(d[0], shell->rest[node[0]]);
            tangent = dgfem_shelli_axpy(tangent, d[1], shell->rest[node[1]]);
            tangent = dgfem_shelli_axpy(tangent, d[2], shell->rest[node[2]]);
            dgfem_real length = factor * dgfem_shelli_gauss_weight(q) * dgfem_shelli_norm(tangent);
            for (int a = 0; a < 3; a++) out[node[a]] = dgfem_shelli_axpy(out[node[a]], length * n[a], load);
        }
    }
}

/* The forces p_a (rotated frame) that balance the moments of a boundary point: J is minus the tilt. */
static void dgfem_shelli_moment_forces(const dgfem_shell *shell, const dgfem_shelli_point *point, dgfem_real moment,
                                       int count, dgfem_vec3 *force) {
    dgfem_real stress = moment * point->weight;
    dgfem_shelli_point_forces(shell->system->strains + point->strain_start, 1, &stress, count, force);
}

/* The rotation of a boundary point for follower moments: its own, whatever holds the edge. */
static void dgfem_shelli_moment_rotation(const dgfem_shell *shell, const dgfem_shelli_group *group,
                                         const dgfem_shelli_point *point, const dgfem_shelli_local *local, int spins,
                                         dgfem_shelli_kinematics *k) {
    k->r = dgfem_shelli_identity();
    if (shell->desc.corotational) dgfem_shelli_rotate(shell, group, point, local, spins, k);
}

static void dgfem_shelli_add_moments(const dgfem_shell *shell, const dgfem_vec3 *x, dgfem_real factor,
                                     dgfem_vec3 *out) {
    for (int g = shell->element_count; g < shell->system->group_count; g++) {
        const dgfem_shelli_group *group = &shell->system->groups[g];
        const dgfem_shell_edge *edge = &shell->edges[group->owner];
        if (edge->moment == 0 && edge->follower_moment == 0) continue;
        dgfem_shelli_local local;
        dgfem_shelli_kinematics k;
        dgfem_shelli_local_take(shell, group, x, &local);
        for (int q = 0; q < group->point_count; q++) {
            const dgfem_shelli_point *point = &shell->system->points[group->point_start + q];
            dgfem_shelli_moment_rotation(shell, group, point, &local, 0, &k);
            dgfem_shelli_moment_forces(shell, point, 1, local.count, k.force);
            for (int a = 0; a < local.count; a++) {
                dgfem_vec3 turned = dgfem_shelli_multiply(&k.r, k.force[a]), *to = &out[local.nodes[a]];
                *to = dgfem_shelli_axpy(*to, -factor * edge->moment, k.force[a]);
                *to = dgfem_shelli_axpy(*to, -factor * edge->follower_moment, turned);
            }
        }
    }
}

/* out += factor * external forces at positions x. In motion (`lumped`) gravity pulls at the lumped masses, so that
   free fall is uniform; at rest it is a load like any other. */
static void dgfem_shelli_add_external(const dgfem_shell *shell, const dgfem_vec3 *x, int lumped, dgfem_real factor,
                                      dgfem_vec3 *out) {
    const dgfem_real *weight = lumped ? shell->node_mass : shell->node_load;
    dgfem_vec3 gravity = dgfem_shelli_between(shell, shell->gravity_before, shell->desc.gravity);
    for (int i = 0; i < shell->node_count; i++) out[i] = dgfem_shelli_axpy(out[i], factor * weight[i], gravity);
    for (int c = 0; c < shell->condition_count; c++) {
        const dgfem_shell_condition *condition = &shell->conditions[c];
        if (condition->kind == DGFEM_SHELL_CONDITION_PRESSURE)
            dgfem_shelli_add_pressure_force(shell, condition, x, factor, out);
        if (condition->kind == DGFEM_SHELL_CONDITION_LINE_LOAD)
            dgfem_shelli_add_line_load(shell, condition, factor, out);
        int pin = condition->kind == DGFEM_SHELL_CONDITION_PIN;
        if (!pin && condition->kind != DGFEM_SHELL_CONDITION_FORCE) continue;
        for (int i = 0; i < condition->count; i++) {
            dgfem_vec3 *to = &out[condition->items[i]], force = dgfem_shelli_vector_now(shell, condition);
            if (pin) force = dgfem_shelli_scale(condition->scalar, dgfem_shelli_sub(force, x[condition->items[i]]));
            *to = dgfem_shelli_axpy(*to, factor, force);
        }
    }
    dgfem_shelli_add_moments(shell, x, factor, out);
}

/* out += factor * those loads that turn with the shell. */
static void dgfem_shelli_add_followers(const dgfem_shell *shell, const dgfem_vec3 *x, dgfem_real factor,
                                       dgfem_vec3 *out) {
    for (int c = 0; c < shell->condition_count; c++)
        if (shell->conditions[c].kind == DGFEM_SHELL_CONDITION_PRESSURE &&
            dgfem_shelli_follows(shell, &shell->conditions[c]))
            dgfem_shelli_add_pressure_force(shell, &shell->conditions[c], x, factor, out);
    dgfem_shelli_add_moments(shell, x, factor, out);
}

/* ---- derivatives ---- */

/* Minus the derivative of a follower pressure, symmetric part: on interior nodes all of it. */
static void dgfem_shelli_assemble_pressure(const dgfem_shell *shell, const dgfem_shell_condition *condition,
                                           const dgfem_vec3 *x, dgfem_real factor) {
    dgfem_real pressure = dgfem_shelli_scalar_now(shell, condition);
    for (int i = 0; i < condition->count; i++) {
        const dgfem_shelli_group *group = dgfem_shelli_element_group(shell, condition->items[i]);
        dgfem_real dense[9 * DGFEM_SHELL_MAX_NODES * DGFEM_SHELL_MAX_NODES];
        dgfem_shelli_local local;
        dgfem_vec3 e1, e2;
        int n = group->node_count, width = 3 * n;
        memset(dense, 0, sizeof dense);
        dgfem_shelli_local_take(shell, group, x, &local);
        for (int q = 0; q < group->point_count; q++) {
            const dgfem_shelli_point *point = &shell->system->points[group->point_start + q];
            const dgfem_shelli_basis *f = &shell->system->basis[point->basis[0]];
            dgfem_real weight;
            (void)dgfem_shelli_pressure(shell, group, point, &local, q, 1, &e1, &e2);
            (void)dgfem_shelli_quadrature(n, q, &weight);
            for (int a = 0; a < n; a++)
                for (int b = 0; b < n; b++) { /* d(e1 x e2) = [e1]x d2 - [e2]x d1 */
                    dgfem_vec3 v = dgfem_shelli_scale(f->d2[b], e1);
                    v = dgfem_shelli_axpy(v, -weight * f->d1[b], e2);
                    dgfem_mat3 m = dgfem_shelli_cross_matrix(dgfem_shelli_scale(-pressure * f->n[a], v));
                    for (int k = 0; k < 9; k++) dense[(3 * a + k / 3) * width + 3 * b + k % 3] += m.m[k / 3][k % 3];
                }
        }
        dgfem_shelli_scatter(shell->system, group, factor, dense);
    }
}

static void dgfem_shelli_assemble_moments(const dgfem_shell *shell, const dgfem_vec3 *x, dgfem_real factor) {
    for (int g = shell->element_count; g < shell->system->group_count; g++) {
        const dgfem_shelli_group *group = &shell->system->groups[g];
        const dgfem_shell_edge *edge = &shell->edges[group->owner];
        dgfem_real dense[9 * DGFEM_SHELL_MAX_NODES * DGFEM_SHELL_MAX_NODES];
        dgfem_shelli_local local;
        dgfem_shelli_kinematics k;
        if (edge->follower_moment == 0 || !shell->desc.corotational) continue;
        memset(dense, 0, sizeof dense);
        dgfem_shelli_local_take(shell, group, x, &local);
        for (int q = 0; q < group->point_count; q++) {
            const dgfem_shelli_point *point = &shell->system->points[group->point_start + q];
            dgfem_shelli_moment_rotation(shell, group, point, &local, 1, &k);
            dgfem_shelli_moment_forces(shell, point, edge->follower_moment, local.count, k.force);
            for (int a = 0; a < local.count; a++) {
                dgfem_mat3 p = dgfem_shelli_cross_matrix(dgfem_shelli_scale(-1, k.force[a]));
                p = dgfem_shelli_multiply3(&k.r, &p);
                for (int b = 0; b < local.count; b++) {
                    dgfem_mat3 m = dgfem_shelli_multiply3(&p, &k.spin[b]);
                    for (int i = 0; i < 9; i++)
                        dense[(3 * a + i / 3) * 3 * local.count + 3 * b + i % 3] += m.m[i / 3][i % 3];
                }
            }
        }
        dgfem_shelli_scatter(shell->system, group, factor, dense);
    }
}

/* matrix += factor * minus the derivative of the external forces (its symmetric part); with `followers` 0 of pins
   only, which keeps the matrix positive definite. */
static void dgfem_shelli_assemble_external(const dgfem_shell *shell, const dgfem_vec3 *x, int followers,
                                           dgfem_real factor) {
    for (int c = 0; c < shell->condition_count; c++) {
        const dgfem_shell_condition *condition = &shell->conditions[c];
        int follows = followers && dgfem_shelli_follows(shell, condition);
        if (condition->kind == DGFEM_SHELL_CONDITION_PRESSURE && follows)
            dgfem_shelli_assemble_pressure(shell, condition, x, factor);
        if (condition->kind != DGFEM_SHELL_CONDITION_PIN) continue;
        for (int i = 0; i < condition->count; i++) {
            dgfem_real *block = shell->system->matrix->values + shell->system->diagonal[condition->items[i]];
            for (int k = 0; k < 9; k += 4) block[k] += factor * condition->scalar;
        }
    }
    if (followers) dgfem_shelli_assemble_moments(shell, x, factor);
}

/* ---- held directions ---- */

/* Holds the displacement of a node along a unit direction. Directions that others hold already have no effect. */
static void dgfem_shelli_hold(dgfem_shell_system *system, int node, dgfem_vec3 direction, dgfem_real value) {
    dgfem_mat3 *free_part = &system->free_part[node];
    dgfem_vec3 rest = dgfem_shelli_multiply(free_part, direction);
    dgfem_real length = dgfem_shelli_norm(rest);
    if (!(length > DGFEM_R(1e-3))) return;
    rest = dgfem_shelli_scale(1 / length, rest);
    value = (value - dgfem_shelli_dot(system->target[node], direction)) / dgfem_shelli_dot(rest, direction);
    system->target[node] = dgfem_shelli_axpy(system->target[node], value, rest);
    dgfem_shelli_add_outer(free_part, -1, rest, rest);
    system->held[node] = 1;
}

static void dgfem_shelli_hold_axes(dgfem_shell_system *system, int node, int axes, dgfem_vec3 displacement) {
    if (axes & DGFEM_SHELL_X) dgfem_shelli_hold(system, node, dgfem_shelli_vec3(1, 0, 0), displacement.x);
    if (axes & DGFEM_SHELL_Y) dgfem_shelli_hold(system, node, dgfem_shelli_vec3(0, 1, 0), displacement.y);
    if (axes & DGFEM_SHELL_Z) dgfem_shelli_hold(system, node, dgfem_shelli_vec3(0, 0, 1), displacement.z);
}

/* Displacement that a condition gives to a node now, if it was where the condition had it `before`; otherwise the
   difference vanishes along the path. */
static dgfem_vec3 dgfem_shelli_held_now(const dgfem_shell *shell, int node, dgfem_vec3 before, dgfem_vec3 now) {
    if (shell->system->part == 1) return now;
    dgfem_vec3 astray = dgfem_shelli_sub(dgfem_shelli_sub(shell->position[node], shell->rest[node]), before);
    return dgfem_shelli_axpy(now, 1 - shell->system->part, astray);
}

static void dgfem_shelli_hold_edge(const dgfem_shell *shell, const dgfem_shell_condition *condition, int edge) {
    int clamp = condition->kind == DGFEM_SHELL_CONDITION_CLAMP;
    dgfem_shelli_placement before = dgfem_shelli_clamp_before(condition), now = before;
    if (clamp) now = dgfem_shelli_clamp_now(shell, condition);
    for (int a = 0; a < 3; a++) {
        int node = shell->edges[edge].node[a];
        dgfem_vec3 x = shell->rest[node], from = dgfem_shelli_vec3(0, 0, 0), to = from;
        if (clamp) {
            from = dgfem_shelli_sub(dgfem_shelli_place(&before, x), x);
            to = dgfem_shelli_sub(dgfem_shelli_place(&now, x), x);
        }
        to = dgfem_shelli_held_now(shell, node, from, to);
        if (clamp) dgfem_shelli_hold_axes(shell->system, node, DGFEM_SHELL_XYZ, to);
        else dgfem_shelli_hold(shell->system, node, condition->vector, dgfem_shelli_dot(condition->vector, to));
    }
}

/* Collects what all conditions hold, at the present part of the path. Returns the number of conditions that hold
   anything. */
static int dgfem_shelli_collect_held(const dgfem_shell *shell) {
    dgfem_shell_system *system = shell->system;
    int holding = 0;
    for (int i = 0; i < shell->node_count; i++) {
        system->held[i] = 0;
        system->free_part[i] = dgfem_shelli_identity();
        system->target[i] = dgfem_shelli_vec3(0, 0, 0);
    }
    for (int c = 0; c < shell->condition_count; c++) {
        const dgfem_shell_condition *condition = &shell->conditions[c];
        int clamp = condition->kind == DGFEM_SHELL_CONDITION_CLAMP;
        holding += clamp || condition->kind == DGFEM_SHELL_CONDITION_FIX ||
                   condition->kind == DGFEM_SHELL_CONDITION_SYMMETRY || condition->kind == DGFEM_SHELL_CONDITION_PIN;
        for (int i = 0; i < condition->count; i++) {
            if (condition->kind == DGFEM_SHELL_CONDITION_FIX)
                dgfem_shelli_hold_axes(system, condition->items[i], condition->axes,
                                       dgfem_shelli_held_now(shell, condition->items[i], condition->vector_before,
                                                             dgfem_shelli_vector_now(shell, condition)));
            if (clamp || condition->kind == DGFEM_SHELL_CONDITION_SYMMETRY)
                dgfem_shelli_hold_edge(shell, condition, condition->items[i]);
        }
    }
    return holding;
}

/* Removes what is held from the matrix: blocks P_r A P_c, and (I - P) times the diagonal's size for the held part. */
static void dgfem_shelli_hold_matrix(const dgfem_shell *shell) {
    const dgfem_shell_system *system = shell->system;
    const dgfem_matrix *matrix = system->matrix;
    for (int r = 0; r < matrix->block_count; r++)
        for (int k = matrix->row_start[r]; k < matrix->row_start[r + 1]; k++) {
            int c = matrix->column[k];
            dgfem_real *block = matrix->values + matrix->value_start[k];
            if (!system->held[r] && !system->held[c]) continue;
            dgfem_mat3 m;
            memcpy(&m, block, sizeof m);
            dgfem_real size = (m.m[0][0] + m.m[1][1] + m.m[2][2]) / 3;
            m = dgfem_shelli_multiply3(&m, &system->free_part[c]);
            m = dgfem_shelli_multiply3(&system->free_part[r], &m);
            for (int i = 0; r == c && i < 9; i++)
                m.m[i / 3][i % 3] += dgfem_shelli_max(size, DGFEM_R(1e-30)) *
                                     ((dgfem_real)(i % 4 == 0) - system->free_part[r].m[i / 3][i % 3]);
            memcpy(block, &m, sizeof m);
        }
}

/* v = P v at held nodes. */
static void dgfem_shelli_hold_vector(const dgfem_shell *shell, dgfem_vec3 *v) {
    for (int i = 0; i < shell->node_count; i++)
        if (shell->system->held[i]) v[i] = dgfem_shelli_multiply(&shell->system->free_part[i], v[i]);
}
