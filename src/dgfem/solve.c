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
    if (body->desc.solver == DGFEM_SOLVER_PCG || body->desc.solver == DGFEM_SOLVER_SWEEPS) {
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
    if (body->step_solver) body->step_solver->is_factored = 0;
    dgfem_cholesky_info factor;
    status = dgfemi_analyse_body(body);
    if (status) return status == DGFEM_ERROR_MEMORY ? dgfemi_fail_memory(hooks) : status;
    status = dgfem_cholesky_factor(body->cholesky, body->matrix, &factor);
    double middle = dgfemi_clock(hooks);
    info->seconds_factor += middle - start;
    info->failed_element = factor.failed_block;
    info->factorizations++;
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

/* Adds the springs of all pins, times `stiffness`, to the matrix, and their force at the current displacement, times
   `force`, to the right-hand side. Their places are at `factor` of the way from where the points are at rest. */
static void dgfemi_assemble_pins(const dgfem_body *body, dgfem_real stiffness, dgfem_real force, dgfem_real factor,
                                 dgfem_matrix *matrix, dgfem_vec3 *rhs) {
    const dgfem_mat3 identity = dgfemi_identity();
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_condition *pin = &body->conditions[c];
        if (pin->kind != DGFEM_CONDITION_PIN) continue;
        int e = pin->items[0], n = dgfemi_element_basis(body, e);
        dgfem_real basis[DGFEM_MAX_BASIS], *block = dgfem_matrix_block(matrix, e, e);
        dgfem_vec3 reach = dgfemi_scale(factor, dgfemi_sub(pin->vector, pin->point));
        dgfemi_basis_evaluate(body->degree[e], body->origin[e], body->scale[e], pin->point, basis);
        reach = dgfemi_sub(reach, dgfemi_evaluate(body, body->displacement, e, pin->point));
        dgfemi_add_weighted(body, e, basis, dgfemi_scale(force * pin->scalar, reach), rhs);
        dgfemi_add_kronecker(block, basis, n, stiffness * pin->scalar, &identity);
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
        memset(block, 0, (size_t)m * (size_t)n * sizeof *block);
    }
    dgfem_real *diagonal = dgfem_matrix_block(matrix, e, e), size = 0;
    dgfem_real *out = (dgfem_real *)(void *)(rhs + body->basis_start[e]);
    for (int i = 0; i < n; i++) size = dgfemi_max(size, diagonal[i * n + i]);
    memset(diagonal, 0, (size_t)n * (size_t)n * sizeof *diagonal);
    for (int i = 0; i < n; i++) {
        diagonal[i * n + i] = size;
        out[i] = size * value[i];
    }
}

/* Holds all held elements in the system, or where `matrix` is NULL writes their unknowns to x, so that an iterative
   solver's error spares them. The unknowns are the velocities that lead in dt from the current displacement to `factor`
   times the prescribed one. */
static void dgfemi_hold_elements(const dgfem_body *body, dgfem_real dt, dgfem_real factor, dgfem_matrix *matrix,
                                 dgfem_vec3 *rhs_or_x) {
    dgfem_vec3 x[DGFEM_MAX_BASIS];
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_condition *condition = &body->conditions[c];
        const dgfem_vec3 *target = condition->values;
        if (condition->kind != DGFEM_CONDITION_FIX_ELEMENTS) continue;
        for (int i = 0; i < condition->count; i++) {
            int e = condition->items[i], n = dgfemi_element_basis(body, e);
            const dgfem_vec3 *now = body->displacement + body->basis_start[e];
            for (int k = 0; k < n; k++)
                x[k] = dgfemi_scale(1 / dt, dgfemi_sub(dgfemi_scale(factor, target[k]), now[k]));
            if (matrix) dgfemi_hold_element(body, e, x, matrix, rhs_or_x);
            else memcpy(rhs_or_x + body->basis_start[e], x, (size_t)n * sizeof *x);
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
    dgfem_matrix_multiply(body->matrix, (const dgfem_real *)(const void *)body->displacement, (dgfem_real *)(void *)ku);
    dgfemi_external_force(body, dgfemi_next_rotation(body), h, rhs);
    for (int i = 0; i < body->basis_count; i++)
        rhs[i] = dgfemi_add_scaled(dgfemi_add_scaled(rhs[i], h, f0[i]), -h / stiffness, ku[i]);
    dgfemi_add_mass_product(body, 1, body->velocity, rhs);
    dgfemi_assemble_mass(body, 1 + h * body->desc.damping_mass, body->matrix);
    dgfemi_assemble_pins(body, h * h, h, 1, body->matrix, rhs);
    double middle = dgfemi_clock(&body->hooks);
    info->seconds_assemble += middle - start;
    if (body->shape_count) info->contacts = dgfemi_contacts_assemble(body->contacts, body, h, body->matrix, rhs);
    dgfemi_hold_elements(body, h, 1, body->matrix, rhs);
    info->seconds_contact += dgfemi_clock(&body->hooks) - middle;
}

static dgfem_status dgfemi_step(dgfem_body *body, dgfem_real h, dgfem_step_info *info) {
    dgfem_vec3 *rhs = dgfemi_work(body, DGFEMI_WORK_RHS), *v = dgfemi_work(body, DGFEMI_WORK_X);
    size_t size = (size_t)body->basis_count * sizeof *v;
    dgfemi_assemble_step(body, h, rhs, info);
    if (!body->step_solver) memcpy(v, body->velocity, size);
    dgfem_status status =
        body->step_solver
            ? dgfemi_solve_step(body, h, dgfemi_next_rotation(body), (const dgfem_real *)(const void *)rhs,
                                (dgfem_real *)(void *)v, info)
            : dgfemi_body_solve(body, rhs, v, info);
    if (!status) status = dgfemi_check_solution(body, v);
    if (status) return status;
    dgfemi_hold_elements(body, h, 1, NULL, v);
    if (body->step_solver) dgfemi_remember_change(body);
    for (int i = 0; i < body->basis_count; i++) {
        body->change[i] = dgfemi_sub(v[i], body->velocity[i]);
        body->displacement[i] = dgfemi_add_scaled(body->displacement[i], h, v[i]);
    }
    memcpy(body->velocity, v, size);
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

/* ---- what holds the body ---- */

/* The conditions on the rigid motions t + w x (x - centre) / size of one piece of the body (elements connected by
   glue), as a Gram matrix over (t, w): a motion that no condition sees is in its kernel. */
typedef struct dgfemi_hold {
    int element; /* one of the piece */
    dgfem_vec3 lower, upper;
    double gram[6][6];
} dgfemi_hold;

/* The component along `direction` at x is held. */
static void dgfemi_hold_direction(dgfemi_hold *hold, dgfem_vec3 x, dgfem_vec3 direction) {
    dgfem_vec3 arm = dgfemi_add_scaled(x, DGFEM_R(-0.5), dgfemi_add(hold->lower, hold->upper));
    dgfem_vec3 turn = dgfemi_cross(arm, direction);
    double size = (double)dgfemi_distance(hold->lower, hold->upper), row[6];
    for (int a = 0; a < 3; a++) {
        row[a] = (double)dgfemi_axis(direction, a);
        row[3 + a] = (double)dgfemi_axis(turn, a) / size;
    }
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) hold->gram[i][j] += row[i] * row[j];
}

static void dgfemi_hold_point(dgfemi_hold *hold, dgfem_vec3 x) {
    dgfem_mat3 identity = dgfemi_identity();
    for (int a = 0; a < 3; a++) dgfemi_hold_direction(hold, x, dgfemi_column(&identity, a));
}

static void dgfemi_hold_face(const dgfem_mesh *mesh, const dgfem_face *face, int normal_only, dgfemi_hold *hold) {
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++)
        for (int k = mesh->loops[l].start; k < mesh->loops[l].start + mesh->loops[l].count; k++) {
            dgfem_vec3 x = mesh->vertices[mesh->loop_vertices[k]];
            if (normal_only) dgfemi_hold_direction(hold, x, face->normal);
            else dgfemi_hold_point(hold, x);
        }
}

static void dgfemi_hold_pieces(const dgfem_body *body, const int *piece, dgfemi_hold *holds) {
    const dgfem_mesh *mesh = body->mesh;
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_condition *condition = &body->conditions[c];
        int normal_only = condition->kind == DGFEM_CONDITION_FIX_NORMAL;
        for (int i = 0; i < condition->count; i++) {
            int item = condition->items[i];
            if (condition->kind == DGFEM_CONDITION_FIX_FACES || normal_only) {
                const dgfem_face *face = &mesh->faces[item];
                dgfemi_hold_face(mesh, face, normal_only, &holds[piece[face->element[0]]]);
            } else if (condition->kind == DGFEM_CONDITION_PIN) {
                dgfemi_hold_point(&holds[piece[item]], condition->point);
            } else if (condition->kind == DGFEM_CONDITION_FIX_ELEMENTS) {
                const dgfem_element *element = &mesh->elements[item];
                for (int k = element->face_start; k < element->face_start + element->face_count; k++)
                    dgfemi_hold_face(mesh, &mesh->faces[mesh->element_faces[k]], 0, &holds[piece[item]]);
            }
        }
    }
}

/* Cholesky. The bound lets a face hold a body of 1e5 times its size, and is far above round-off in float. */
static int dgfemi_hold_is_complete(dgfemi_hold *hold) {
    const double bound = 1e-10;
    double(*a)[6] = hold->gram, mean = 0;
    for (int j = 0; j < 6; j++) mean += a[j][j] / 6;
    for (int j = 0; j < 6; j++) {
        for (int k = 0; k < j; k++) a[j][j] -= a[j][k] * a[j][k];
        if (!(a[j][j] > bound * mean)) return 0;
        a[j][j] = sqrt(a[j][j]);
        for (int i = j + 1; i < 6; i++) {
            for (int k = 0; k < j; k++) a[i][j] -= a[i][k] * a[j][k];
            a[i][j] /= a[j][j];
        }
    }
    return 1;
}

/* *element = one of a piece that the conditions leave free to move as a rigid body, to first order about its rest
   position; DGFEM_NONE when there is none. */
static dgfem_status dgfemi_find_free_piece(const dgfem_body *body, int *element) {
    size_t n = (size_t)body->mesh->element_count;
    dgfemi_arena arena = dgfemi_arena_make(&body->hooks);
    int *piece = (int *)dgfemi_arena_allocate(&arena, 2 * n, sizeof(int)), count = 0;
    if (piece) count = dgfemi_mesh_pieces(body->mesh, piece, piece + n);
    dgfemi_hold *holds = (dgfemi_hold *)dgfemi_arena_allocate_zero(&arena, (size_t)count, sizeof *holds);
    *element = DGFEM_NONE;
    if (!piece || !holds) {
        dgfemi_arena_free(&arena);
        return dgfemi_fail_memory(&body->hooks);
    }
    for (int e = body->mesh->element_count - 1; e >= 0; e--) {
        dgfemi_hold *hold = &holds[piece[e]];
        dgfem_real r = body->mesh->elements[e].radius;
        dgfem_vec3 lower = dgfemi_sub(body->origin[e], dgfemi_vec3(r, r, r));
        dgfem_vec3 upper = dgfemi_add(body->origin[e], dgfemi_vec3(r, r, r));
        int fresh = !(hold->upper.x > hold->lower.x);
        hold->element = e;
        hold->lower = fresh ? lower : dgfemi_min3(hold->lower, lower);
        hold->upper = fresh ? upper : dgfemi_max3(hold->upper, upper);
    }
    dgfemi_hold_pieces(body, piece, holds);
    for (int k = 0; k < count && *element == DGFEM_NONE; k++)
        if (!dgfemi_hold_is_complete(&holds[k])) *element = holds[k].element;
    dgfemi_arena_free(&arena);
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_held(const dgfem_body *body) {
    int element;
    dgfem_status status = dgfemi_find_free_piece(body, &element);
    if (status || element == DGFEM_NONE) return status;
    for (int c = 0; c < body->condition_count; c++)
        if (body->conditions[c].kind <= DGFEM_CONDITION_PIN)
            return dgfemi_fail(&body->hooks, DGFEM_ERROR_UNCONSTRAINED,
                               "static solve: the conditions leave the piece of element %d free to move or turn",
                               element);
    return dgfemi_fail(&body->hooks, DGFEM_ERROR_UNCONSTRAINED, "static solve: nothing holds the body");
}

/* ---- static solve ---- */

/* |b - A x| / |b| */
static dgfem_real dgfemi_linear_residual(const dgfem_body *body, const dgfem_vec3 *b, const dgfem_vec3 *x) {
    dgfem_vec3 *r = dgfemi_work(body, DGFEMI_WORK_Y);
    double norm = dgfemi_vector_norm(body->basis_count, b);
    dgfem_matrix_multiply(body->matrix, (const dgfem_real *)(const void *)x, (dgfem_real *)(void *)r);
    for (int i = 0; i < body->basis_count; i++) r[i] = dgfemi_sub(b[i], r[i]);
    return norm > 0 ? (dgfem_real)(dgfemi_vector_norm(body->basis_count, r) / norm) : 0;
}

/* One correction of the displacement, K_w dU = factor F - f(U), with the rotations of the current displacement. Solving
   for the correction rather than for U + dU makes errors of the solver vanish with it. info->residual becomes
   |dU| / |U + dU|, or without warping, where one correction does, the residual of the linear system. */
static dgfem_status dgfemi_static_sweep(dgfem_body *body, dgfem_real factor, dgfem_step_info *info) {
    dgfem_vec3 *force = dgfemi_work(body, DGFEMI_WORK_F0), *rhs = dgfemi_work(body, DGFEMI_WORK_RHS);
    dgfem_vec3 *x = dgfemi_work(body, DGFEMI_WORK_X);
    dgfem_mat3 *rotation = dgfemi_next_rotation(body);
    size_t size = (size_t)body->basis_count * sizeof *x;
    double start = dgfemi_clock(&body->hooks);
    dgfemi_rotations(body, rotation);
    dgfemi_assemble_stiffness(body, rotation, 1, factor, body->matrix, NULL);
    dgfemi_external_force(body, rotation, factor, rhs);
    memset(force, 0, size);
    (void)dgfemi_elastic_energy(body, rotation, factor, force);
    for (int i = 0; i < body->basis_count; i++) rhs[i] = dgfemi_sub(rhs[i], force[i]);
    dgfemi_assemble_pins(body, 1, 1, factor, body->matrix, rhs);
    dgfemi_hold_elements(body, 1, factor, body->matrix, rhs);
    memset(x, 0, size);
    info->seconds_assemble += dgfemi_clock(&body->hooks) - start;
    dgfem_status status = dgfemi_body_solve(body, rhs, x, info);
    if (!status) status = dgfemi_check_solution(body, x);
    if (status) return status;
    dgfem_real residual = body->desc.warp ? 0 : dgfemi_linear_residual(body, rhs, x);
    dgfemi_hold_elements(body, 1, factor, NULL, x);
    for (int i = 0; i < body->basis_count; i++) body->displacement[i] = dgfemi_add(body->displacement[i], x[i]);
    double whole = dgfemi_vector_norm(body->basis_count, body->displacement);
    if (body->desc.warp && whole > 0) residual = (dgfem_real)(dgfemi_vector_norm(body->basis_count, x) / whole);
    info->residual = residual;
    dgfemi_commit_rotation(body);
    info->sweeps++;
    return DGFEM_OK;
}

static dgfem_status dgfemi_static_load(dgfem_body *body, const dgfem_static_desc *desc, dgfem_real factor,
                                       dgfem_step_info *info) {
    for (int sweep = 0; sweep < desc->max_sweeps; sweep++) {
        dgfem_status status = dgfemi_static_sweep(body, factor, info);
        if (status) return status;
        if (!body->desc.warp || info->residual <= desc->tolerance) return DGFEM_OK;
    }
    return dgfemi_fail(&body->hooks, DGFEM_ERROR_NOT_CONVERGED,
                       "static solve at %g of the load: the displacement still changes by %g after %d sweeps",
                       (double)factor, (double)info->residual, desc->max_sweeps);
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

DGFEM_API dgfem_status dgfem_body_solve_static(dgfem_body *body, const dgfem_static_desc *desc, dgfem_step_info *info) {
    dgfem_step_info local = dgfemi_empty_info();
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (info) *info = local;
    dgfem_status status = dgfemi_check_desc(&body->hooks, desc, desc ? desc->cookie : 0, "static solve");
    if (!status) status = dgfemi_check_positive(&body->hooks, desc->tolerance, "static solve: tolerance");
    if (!status && (desc->load_steps < 1 || desc->max_sweeps < 1))
        status =
            dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "static solve: %d load steps, %d sweeps, expected >= 1",
                        desc->load_steps, desc->max_sweeps);
    if (!status) status = dgfemi_check_held(body);
    if (!status) status = dgfemi_solve_static(body, desc, &local);
    if (info) *info = local;
    return status;
}
