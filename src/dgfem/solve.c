#pragma once
#include "load.c"
/* Moving a solid: the time step and the static solve. */

/* ---- the linear system ---- */

/* Element of an unknown block: they are numbered alike. */
static dgfem_status dgfemi_body_solve(dgfem_body *body, const dgfem_vec3 *rhs, dgfem_vec3 *x, dgfem_step_info *info) {
    const dgfem_hooks *hooks = &body->hooks;
    const dgfem_real *b = (const dgfem_real *)(const void *)rhs;
    dgfem_real *out = (dgfem_real *)(void *)x;
    double start = dgfemi_clock(hooks);
    dgfem_status status;
    if (body->desc.solver == DGFEM_SOLVER_PCG) {
        dgfem_pcg_desc desc = dgfem_default_pcg_desc();
        dgfem_pcg_info pcg;
        desc.tolerance = body->desc.solver_tolerance;
        desc.max_iterations = body->desc.solver_iterations;
        desc.work = (dgfem_real *)(void *)dgfemi_work(body, DGFEMI_WORK_COUNT);
        desc.hooks = *hooks;
        status = dgfem_pcg(body->matrix, &desc, b, out, &pcg);
        info->iterations += pcg.iterations;
        info->residual = pcg.residual;
        info->failed_element = pcg.failed_block;
        info->seconds_solve += dgfemi_clock(hooks) - start;
        return status;
    }
    dgfem_cholesky_info factor;
    status = dgfem_cholesky_factor(body->cholesky, body->matrix, &factor);
    double middle = dgfemi_clock(hooks);
    info->seconds_factor += middle - start;
    info->failed_element = factor.failed_block;
    if (!status) status = dgfem_cholesky_solve(body->cholesky, b, out);
    info->seconds_solve += dgfemi_clock(hooks) - middle;
    return status;
}

static dgfem_status dgfemi_check_solution(const dgfem_body *body, const dgfem_vec3 *x) {
    for (int e = 0; e < body->mesh->element_count; e++)
        for (int i = body->basis_start[e]; i < body->basis_start[e + 1]; i++)
            if (!dgfemi_is_finite3(x[i]))
                return dgfemi_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "solution in element %d", e);
    return DGFEM_OK;
}

/* The rotations being computed live behind the current ones until the call succeeds. */
static dgfem_mat3 *dgfemi_next_rotation(const dgfem_body *body) { return body->rotation + body->mesh->element_count; }

static void dgfemi_commit_rotation(dgfem_body *body) {
    memcpy(body->rotation, dgfemi_next_rotation(body), (size_t)body->mesh->element_count * sizeof *body->rotation);
}

static dgfem_step_info dgfemi_empty_info(void) {
    dgfem_step_info info;
    memset(&info, 0, sizeof info);
    info.failed_element = DGFEM_NONE;
    return info;
}

/* ---- pins and held elements ---- */

/* Adds the springs of all pins, `weight` times, to the matrix, and their force at the current displacement (step) or at
   zero displacement (static solve) to the right-hand side. */
static void dgfemi_assemble_pins(const dgfem_body *body, dgfem_real weight, dgfem_real load,
                                 const dgfem_vec3 *displacement,                                 dgfem_matrix *matrix, dgfem_vec3 *rhs) {
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_condition *pin = &body->conditions[c];
        if (pin->kind != DGFEM_CONDITION_PIN) continue;
        int e = pin->items[0], n = dgfemi_element_basis(body, e);
        dgfem_real basis[DGFEM_MAX_BASIS], *block = dgfem_matrix_block(matrix, e, e);
        dgfem_vec3 reach = dgfemi_sub(pin->vector, pin->point), *out = rhs + body->basis_start[e];
        dgfemi_basis_evaluate(body->degree[e], body->origin[e], body->scale[e], pin->point, basis);
        if (displacement) reach = dgfemi_sub(reach, dgfemi_evaluate(body, displacement, e, pin->point));
        for (int i = 0; i < n; i++) {
            out[i] = dgfemi_add_scaled(out[i], load * pin->scalar * basis[i], reach);
            for (int j = 0; j < n; j++)
                for (int a = 0; a < 3; a++)
                    block[(3 * i + a) * 3 * n + 3 * j + a] += weight * pin->scalar * basis[i] * basis[j];
        }
    }
}

/* Moves the columns of element e, whose unknowns are x, to the right-hand side of its neighbours and makes its own
   rows the identity times the size of its diagonal. A neighbour met through two faces has a zero block the second
   time. */
static void dgfemi_hold_element(const dgfem_body *body, int e, const dgfem_vec3 *x, dgfem_matrix *matrix,
                                dgfem_vec3 *rhs) {
    const dgfem_element *element = &body->mesh->elements[e];
    int n = 3 * dgfemi_element_basis(body, e);
    const dgfem_real *value = (const dgfem_real *)(const void *)x;
    for (int k = 0; k < element->face_count; k++) {
        const dgfem_face *face = &body->mesh->faces[body->mesh->element_faces[element->face_start + k]];
        int other = face->element[face->element[0] == e];
        if (other == DGFEM_NONE || face->cut) continue;
        int m = 3 * dgfemi_element_basis(body, other);
        dgfem_real *block = dgfem_matrix_block(matrix, other > e ? other : e, other > e ? e : other);
        dgfem_real *out = (dgfem_real *)(void *)(rhs + body->basis_start[other]);
        for (int i = 0; i < m; i++)
            for (int j = 0; j < n; j++) out[i] -= (other > e ? block[i * n + j] : block[j * m + i]) * value[j];
        memset(block, 0, (size_t)(m * n) * sizeof *block);
    }
    dgfem_real *diagonal = dgfem_matrix_block(matrix, e, e), size = 0;
    dgfem_real *out = (dgfem_real *)(void *)(rhs + body->basis_start[e]);
    for (int i = 0; i < n; i++) size = dgfemi_max(size, diagonal[i * n + i]);
    memset(diagonal, 0, (size_t)(n * n) * sizeof *diagonal);
    for (int i = 0; i < n; i++) {
        diagonal[i * n + i] = size;
        out[i] = size * value[i];
    }
}

/* Holds all held elements. The unknown is the displacement (dt = 0) or the velocity that reaches it after dt. */
static void dgfemi_hold_elements(const dgfem_body *body, dgfem_real dt, dgfem_matrix *matrix, dgfem_vec3 *rhs) {
    dgfem_vec3 x[DGFEM_MAX_BASIS];
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_condition *condition = &body->conditions[c];
        const dgfem_vec3 *target = condition->values;
        if (condition->kind != DGFEM_CONDITION_FIX_ELEMENTS) continue;
        for (int i = 0; i < condition->count; i++) {
            int e = condition->items[i], n = dgfemi_element_basis(body, e);
            const dgfem_vec3 *now = body->displacement + body->basis_start[e];
            for (int k = 0; k < n; k++) x[k] = dt > 0 ? dgfemi_scale(1 / dt, dgfemi_sub(target[k], now[k])) : target[k];
            dgfemi_hold_element(body, e, x, matrix, rhs);
            target += n;
        }
    }
}

/* ---- time step ---- */

/* System of one step: (M + h D + h^2 K) v+ = M v + h (F + f0 - K U), D = alpha M + beta K, contact added. */
static void dgfemi_assemble_step(dgfem_body *body, dgfem_real h, dgfem_vec3 *rhs, dgfem_step_info *info) {
    dgfem_vec3 *f0 = dgfemi_work(body, DGFEMI_WORK_F0), *ku = dgfemi_work(body, DGFEMI_WORK_Y);
    dgfem_real stiffness = h * h + h * body->desc.damping_stiffness;
    double start = dgfemi_clock(&body->hooks);
    dgfemi_rotations(body, dgfemi_next_rotation(body));
    dgfemi_assemble_stiffness(body, dgfemi_next_rotation(body), stiffness, 1, body->matrix, f0);
    dgfem_matrix_multiply(body->matrix, (const dgfem_real *)(const void *)body->displacement,
                          (dgfem_real *)(void *)ku);
    dgfemi_external_force(body, dgfemi_next_rotation(body), h, rhs);
    for (int i = 0; i < body->basis_count; i++)
        rhs[i] = dgfemi_add_scaled(dgfemi_add_scaled(rhs[i], h, f0[i]), -h / stiffness, ku[i]);
    dgfemi_add_mass_product(body, 1, body->velocity, rhs);
    dgfemi_assemble_mass(body, 1 + h * body->desc.damping_mass, body->matrix);
    dgfemi_assemble_pins(body, h * h, h, body->displacement, body->matrix, rhs);
    double middle = dgfemi_clock(&body->hooks);
    info->seconds_assemble += middle - start;
    if (body->shape_count) info->contacts = dgfemi_contacts_assemble(body->contacts, body, h, body->matrix, rhs);
    dgfemi_hold_elements(body, h, body->matrix, rhs);
    info->seconds_contact += dgfemi_clock(&body->hooks) - middle;
}

static dgfem_status dgfemi_step(dgfem_body *body, dgfem_real h, dgfem_step_info *info) {
    dgfem_vec3 *rhs = dgfemi_work(body, DGFEMI_WORK_RHS), *v = dgfemi_work(body, DGFEMI_WORK_X);
    size_t size = (size_t)body->basis_count * sizeof *v;
    dgfemi_assemble_step(body, h, rhs, info);
    memcpy(v, body->velocity, size);
    dgfem_status status = dgfemi_body_solve(body, rhs, v, info);
    if (!status) status = dgfemi_check_solution(body, v);
    if (status) return status;
    memcpy(body->velocity, v, size);
    for (int i = 0; i < body->basis_count; i++)
        body->displacement[i] = dgfemi_add_scaled(body->displacement[i], h, v[i]);
    dgfemi_commit_rotation(body);
    body->time += (double)h;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_body_step(dgfem_body *body, dgfem_real dt, dgfem_step_info *info) {
    dgfem_step_info local = dgfemi_empty_info();
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (info) *info = local;
    dgfem_status status = dgfemi_check_positive(&body->hooks, dt, "step: dt");
    if (!status) status = dgfemi_step(body, dt, &local);
    if (info) *info = local;
    return status;
}

/* ---- static solve ---- */

/* One solve of K_w U = load (F + g) + f0 with the rotations of the current displacement. Sets *change to the change of
   the displacement relative to its size. */
static dgfem_status dgfemi_static_sweep(dgfem_body *body, dgfem_real load, dgfem_real *change, dgfem_step_info *info) {
    dgfem_vec3 *f0 = dgfemi_work(body, DGFEMI_WORK_F0), *rhs = dgfemi_work(body, DGFEMI_WORK_RHS);
    dgfem_vec3 *x = dgfemi_work(body, DGFEMI_WORK_X);
    double start = dgfemi_clock(&body->hooks);
    dgfemi_rotations(body, dgfemi_next_rotation(body));
    dgfemi_assemble_stiffness(body, dgfemi_next_rotation(body), 1, load, body->matrix, f0);
    dgfemi_external_force(body, dgfemi_next_rotation(body), load, rhs);
    for (int i = 0; i < body->basis_count; i++) rhs[i] = dgfemi_add(rhs[i], f0[i]);
    dgfemi_assemble_pins(body, 1, 1, NULL, body->matrix, rhs);
    dgfemi_hold_elements(body, 0, body->matrix, rhs);
    memcpy(x, body->displacement, (size_t)body->basis_count * sizeof *x);
    info->seconds_assemble += dgfemi_clock(&body->hooks) - start;
    dgfem_status status = dgfemi_body_solve(body, rhs, x, info);
    if (!status) status = dgfemi_check_solution(body, x);
    if (status) return status;
    dgfem_real difference = 0, size = 0;
    for (int i = 0; i < body->basis_count; i++) {
        dgfem_vec3 d = dgfemi_sub(x[i], body->displacement[i]);
        difference += dgfemi_dot(d, d);
        size += dgfemi_dot(x[i], x[i]);
        body->displacement[i] = x[i];
    }
    *change = size > 0 ? dgfemi_sqrt(difference / size) : 0;
    dgfemi_commit_rotation(body);
    info->sweeps++;
    return DGFEM_OK;
}

static dgfem_status dgfemi_static_load(dgfem_body *body, const dgfem_static_desc *desc, dgfem_real load,
                                       dgfem_step_info *info) {
    for (int sweep = 0; sweep < desc->max_sweeps; sweep++) {
        dgfem_status status = dgfemi_static_sweep(body, load, &info->residual, info);
        if (status) return status;
        if (!body->desc.warp || info->residual <= desc->tolerance) return DGFEM_OK;
    }
    return dgfemi_fail(&body->hooks, DGFEM_ERROR_NOT_CONVERGED,
                       "static solve at %g of the load: the displacement still changes by %g after %d sweeps",
                       (double)load, (double)info->residual, desc->max_sweeps);
}

static dgfem_status dgfemi_solve_static(dgfem_body *body, const dgfem_static_desc *desc, dgfem_step_info *info) {
    size_t vectors = (size_t)body->basis_count * sizeof(dgfem_vec3);
    size_t rotations = (size_t)body->mesh->element_count * sizeof(dgfem_mat3);
    dgfem_status status = DGFEM_OK;
    char *saved = (char *)dgfemi_allocate(&body->hooks, vectors + rotations, 1);
    if (!saved) return dgfemi_fail_memory(&body->hooks);
    memcpy(saved, body->displacement, vectors);
    memcpy(saved + vectors, body->rotation, rotations);
    for (int step = 1; !status && step <= desc->load_steps; step++)
        status = dgfemi_static_load(body, desc, (dgfem_real)step / (dgfem_real)desc->load_steps, info);
    if (status) {
        memcpy(body->displacement, saved, vectors);
        memcpy(body->rotation, saved + vectors, rotations);
    } else {
        memset(body->velocity, 0, vectors);
    }
    dgfemi_free(&body->hooks, saved);
    return status;
}

/* Whether any condition can keep the body from drifting away. */
static int dgfemi_is_held(const dgfem_body *body) {
    for (int c = 0; c < body->condition_count; c++)
        if (body->conditions[c].kind <= DGFEM_CONDITION_PIN) return 1;
    return 0;
}

DGFEM_API dgfem_status dgfem_body_solve_static(dgfem_body *body, const dgfem_static_desc *desc, dgfem_step_info *info) {
    dgfem_step_info local = dgfemi_empty_info();
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (info) *info = local;
    dgfem_status status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (!status) status = dgfemi_check_positive(&body->hooks, desc->tolerance, "static solve: tolerance");
    if (!status && (desc->load_steps < 1 || desc->max_sweeps < 1))
        status = dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "static solve: %d load steps, %d sweeps, expected >= 1",
                             desc->load_steps, desc->max_sweeps);
    if (!status && !dgfemi_is_held(body))
        status = dgfemi_fail(&body->hooks, DGFEM_ERROR_UNCONSTRAINED, "static solve: nothing holds the body");
    if (!status) status = dgfemi_solve_static(body, desc, &local);
    if (info) *info = local;
    return status;
}
