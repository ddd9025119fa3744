#pragma once
#include "step.c"
/* What can be asked about a shell's state. */

/* Values per node come as an array of node_count triples. */
static dgfem_status dgfem_shelli_set_nodes(dgfem_shell *shell, const dgfem_points_in *points, const char *what,
                                           dgfem_vec3 *out) {
    dgfem_status status = dgfem_shelli_check_points(&shell->hooks, points, what);
    if (status) return status;
    if (points->count != shell->node_count)
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "%s: %d points for %d nodes", what, points->count,
                                 shell->node_count);
    for (int i = 0; i < points->count; i++)
        if (!dgfem_shelli_is_finite3(dgfem_shelli_read_point(points, i)))
            return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_NOT_FINITE, "%s: node %d", what, i);
    for (int i = 0; i < points->count; i++) out[i] = dgfem_shelli_read_point(points, i);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_set_positions(dgfem_shell *shell, dgfem_points_in positions) {
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    return dgfem_shelli_set_nodes(shell, &positions, "positions", shell->position);
}

DGFEM_API dgfem_status dgfem_shell_set_velocities(dgfem_shell *shell, dgfem_points_in velocities) {
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    return dgfem_shelli_set_nodes(shell, &velocities, "velocities", shell->velocity);
}

/* ---- points of elements ---- */

static dgfem_status dgfem_shelli_check_point(const dgfem_shell *shell, int element, dgfem_real a, dgfem_real b) {
    if (element < 0 || element >= shell->element_count)
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_INDEX, "element %d of %d", element, shell->element_count);
    dgfem_status status = dgfem_shelli_check_real(shell, a, "parameter");
    return status ? status : dgfem_shelli_check_real(shell, b, "parameter");
}

DGFEM_API dgfem_status dgfem_shell_evaluate(const dgfem_shell *shell, int element, dgfem_real a, dgfem_real b,
                                            dgfem_vec3 *position, dgfem_vec3 *normal) {
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_point(shell, element, a, b);
    if (status) return status;
    const dgfem_shell_element *e = &shell->elements[element];
    dgfem_vec3 x[DGFEM_SHELL_MAX_NODES];
    dgfem_shelli_basis f;
    dgfem_shelli_gather(shell->position, e->node, e->node_count, x);
    dgfem_shelli_basis_at(e->node_count, dgfem_shelli_parameter_make(a, b), &f);
    if (position) *position = dgfem_shelli_sum(f.n, x, e->node_count);
    if (normal)
        *normal = dgfem_shelli_unit(
            dgfem_shelli_cross(dgfem_shelli_sum(f.d1, x, e->node_count), dgfem_shelli_sum(f.d2, x, e->node_count)));
    return DGFEM_OK;
}

/* Tensor components from parametric 11, 22, 2*12 (covariant) to the orthonormal axes f1, f2. */
static void dgfem_shelli_to_axes(const dgfem_shelli_frame *frame, dgfem_vec3 f1, dgfem_vec3 f2, const dgfem_real *in,
                                 dgfem_real *out) {
    dgfem_real a1 = dgfem_shelli_dot(frame->c1, f1), a2 = dgfem_shelli_dot(frame->c2, f1);
    dgfem_real b1 = dgfem_shelli_dot(frame->c1, f2), b2 = dgfem_shelli_dot(frame->c2, f2);
    out[0] = in[0] * a1 * a1 + in[1] * a2 * a2 + in[2] * a1 * a2;
    out[1] = in[0] * b1 * b1 + in[1] * b2 * b2 + in[2] * b1 * b2;
    out[2] = in[0] * a1 * b1 + in[1] * a2 * b2 + DGFEM_R(0.5) * in[2] * (a1 * b2 + a2 * b1);
}

/* Plane stress: in[3] tensor components of strain, out[3] of stress. */
static void dgfem_shelli_plane_stress(dgfem_real stiffness, dgfem_real nu, const dgfem_real *in, dgfem_real *out) {
    out[0] = stiffness * (in[0] + nu * in[1]);
    out[1] = stiffness * (in[1] + nu * in[0]);
    out[2] = stiffness * (1 - nu) * in[2];
}

/* The rotation at any point of an element, as at its quadrature points. */
static dgfem_mat3 dgfem_shelli_rotation_at(const dgfem_shell *shell, const dgfem_shelli_basis *f,
                                           const dgfem_shelli_frame *frame, const dgfem_vec3 *x, int n) {
    dgfem_vec3 e1 = dgfem_shelli_sum(f->d1, x, n), e2 = dgfem_shelli_sum(f->d2, x, n);
    dgfem_mat3 gradient, identity = dgfem_shelli_identity();
    if (!shell->desc.corotational) return identity;
    memset(&gradient, 0, sizeof gradient);
    dgfem_shelli_add_outer(&gradient, 1, e1, frame->c1);
    dgfem_shelli_add_outer(&gradient, 1, e2, frame->c2);
    dgfem_shelli_add_outer(&gradient, 1, dgfem_shelli_unit(dgfem_shelli_cross(e1, e2)), frame->t);
    return dgfem_shelli_polar(&gradient, &identity);
}

DGFEM_API dgfem_status dgfem_shell_strain_at(const dgfem_shell *shell, int element, dgfem_real a, dgfem_real b,
                                             dgfem_shell_strain *out) {
    if (!shell || !out) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_point(shell, element, a, b);
    if (status) return status;
    const dgfem_shell_element *e = &shell->elements[element];
    dgfem_vec3 x[DGFEM_SHELL_MAX_NODES], rest[DGFEM_SHELL_MAX_NODES];
    dgfem_shelli_basis f;
    dgfem_shelli_frame frame;
    dgfem_real rows[18 * DGFEM_SHELL_MAX_NODES], strain[6];
    int n = e->node_count;
    dgfem_shelli_gather(shell->position, e->node, n, x);
    dgfem_shelli_gather(shell->rest, e->node, n, rest);
    dgfem_shelli_basis_at(n, dgfem_shelli_parameter_make(a, b), &f);
    if (!dgfem_shelli_frame_at(&f, rest, n, &frame)) return dgfem_shelli_fail_degenerate(shell, element);
    out->rotation = dgfem_shelli_rotation_at(shell, &f, &frame, x, n);
    for (int i = n - 1; i >= 0; i--)
        x[i] = dgfem_shelli_sub(dgfem_shelli_multiply_transposed(&out->rotation, dgfem_shelli_sub(x[i], x[0])),
                                dgfem_shelli_sub(rest[i], rest[0]));
    dgfem_shelli_membrane_rows(&f, &frame, n, rows);
    dgfem_shelli_bending_rows(&f, &frame, n, rows + 9 * n);
    for (int i = 0; i < 6; i++) strain[i] = dgfem_shelli_row_product(rows + 3 * n * i, x, n);
    dgfem_vec3 f1 = dgfem_shelli_unit(frame.e1), f2 = dgfem_shelli_cross(frame.t, f1);
    out->frame.m[0][0] = f1.x, out->frame.m[1][0] = f1.y, out->frame.m[2][0] = f1.z;
    out->frame.m[0][1] = f2.x, out->frame.m[1][1] = f2.y, out->frame.m[2][1] = f2.z;
    out->frame.m[0][2] = frame.t.x, out->frame.m[1][2] = frame.t.y, out->frame.m[2][2] = frame.t.z;
    dgfem_shelli_to_axes(&frame, f1, f2, strain, out->membrane);
    dgfem_shelli_to_axes(&frame, f1, f2, strain + 3, out->bending);
    dgfem_shelli_plane_stress(dgfem_shelli_membrane_stiffness(e), e->material.poisson, out->membrane, out->force);
    dgfem_shelli_plane_stress(dgfem_shelli_bending_stiffness(e), e->material.poisson, out->bending, out->moment);
    return DGFEM_OK;
}

/* ---- forces and stiffness ---- */

DGFEM_API dgfem_status dgfem_shell_internal_force(const dgfem_shell *shell, dgfem_vec3 *out) {
    if (!shell || !out) return DGFEM_ERROR_ARGUMENT;
    memset(out, 0, dgfem_shelli_bytes(shell));
    (void)dgfem_shelli_add_internal(shell, shell->position, 0, 1, out);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_tangent_multiply(const dgfem_shell *shell, const dgfem_vec3 *direction,
                                                    dgfem_vec3 *out) {
    if (!shell || !direction || !out) return DGFEM_ERROR_ARGUMENT;
    memset(out, 0, dgfem_shelli_bytes(shell));
    dgfem_shelli_add_tangent_product(shell, shell->position, direction, out);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_external_force(const dgfem_shell *shell, dgfem_vec3 *out) {
    if (!shell || !out) return DGFEM_ERROR_ARGUMENT;
    memset(out, 0, dgfem_shelli_bytes(shell));
    dgfem_shelli_add_external(shell, shell->position, 0, 1, out);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_stiffness(dgfem_shell *shell, int tangent, const dgfem_matrix **out) {
    if (!shell || !out) return DGFEM_ERROR_ARGUMENT;
    dgfem_matrix_clear(shell->system->matrix);
    dgfem_shelli_assemble(shell, shell->position, tangent && shell->desc.corotational, 1, 1);
    *out = shell->system->matrix;
    return DGFEM_OK;
}

/* ---- totals ---- */

/* Kinetic energy, momentum, and angular momentum about the origin, with the mass matrix that steps use. */
typedef struct dgfem_shelli_motion {
    dgfem_real kinetic;
    dgfem_vec3 linear, angular;
} dgfem_shelli_motion;

static void dgfem_shelli_add_motion(dgfem_shelli_motion *motion, dgfem_real mass, dgfem_vec3 x, dgfem_vec3 v) {
    dgfem_vec3 mv = dgfem_shelli_scale(mass, v);
    motion->kinetic += DGFEM_R(0.5) * dgfem_shelli_dot(mv, v);
    motion->linear = dgfem_shelli_add(motion->linear, mv);
    motion->angular = dgfem_shelli_add(motion->angular, dgfem_shelli_cross(x, mv));
}

static dgfem_shelli_motion dgfem_shelli_total_motion(const dgfem_shell *shell) {
    dgfem_shelli_motion motion;
    memset(&motion, 0, sizeof motion);
    for (int i = 0; !shell->desc.consistent_mass && i < shell->node_count; i++)
        dgfem_shelli_add_motion(&motion, shell->node_mass[i], shell->position[i], shell->velocity[i]);
    for (int e = 0; shell->desc.consistent_mass && e < shell->element_count; e++) {
        const dgfem_shell_element *element = &shell->elements[e];
        dgfem_vec3 rest[DGFEM_SHELL_MAX_NODES], x[DGFEM_SHELL_MAX_NODES], v[DGFEM_SHELL_MAX_NODES];
        int n = element->node_count;
        dgfem_real density = element->thickness * element->material.density;
        dgfem_shelli_gather(shell->rest, element->node, n, rest);
        dgfem_shelli_gather(shell->position, element->node, n, x);
        dgfem_shelli_gather(shell->velocity, element->node, n, v);
        for (int q = 0; q < dgfem_shelli_fine_count(n); q++) {
            const dgfem_shelli_basis *f = dgfem_shelli_fine_basis(shell->system, n, q);
            dgfem_shelli_add_motion(&motion, density * dgfem_shelli_fine_area(f, rest, n, q),
                                    dgfem_shelli_sum(f->n, x, n), dgfem_shelli_sum(f->n, v, n));
        }
    }
    return motion;
}

DGFEM_API dgfem_status dgfem_shell_energy(const dgfem_shell *shell, dgfem_energy *out) {
    if (!shell || !out) return DGFEM_ERROR_ARGUMENT;
    memset(out, 0, sizeof *out);
    out->elastic = dgfem_shelli_add_internal(shell, shell->position, 0, 1, NULL);
    out->kinetic = dgfem_shelli_total_motion(shell).kinetic;
    const dgfem_real *weight = shell->desc.consistent_mass ? shell->node_load : shell->node_mass;
    for (int i = 0; i < shell->node_count; i++)
        out->gravity -= weight[i] * dgfem_shelli_dot(shell->desc.gravity, shell->position[i]);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_momentum(const dgfem_shell *shell, dgfem_vec3 *linear, dgfem_vec3 *angular) {
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_shelli_motion motion = dgfem_shelli_total_motion(shell);
    if (linear) *linear = motion.linear;
    if (angular) *angular = motion.angular;
    return DGFEM_OK;
}

DGFEM_API dgfem_real dgfem_shell_mass(const dgfem_shell *shell) {
    dgfem_real mass = 0;
    for (int i = 0; shell && i < shell->node_count; i++) mass += shell->node_mass[i];
    return mass;
}

DGFEM_API dgfem_real dgfem_shell_area(const dgfem_shell *shell) {
    dgfem_real area = 0;
    for (int e = 0; shell && e < shell->element_count; e++) area += shell->elements[e].area;
    return area;
}
