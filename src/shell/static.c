#pragma once
#include "load.c"
/* Static equilibrium by Newton's method or frozen rotations, in load steps.

   A solve follows a path s = 0 .. 1 on which loads go from what they were at the end of the last solve or step to what
   they are now, fixed nodes straight from where they are to their targets, clamps by a screw motion. The first linear
   systems of a part take the symmetric part of the tangent: what is left out is of second order in the strains. Later
   ones, where that is what is left to converge, take all of it, by a few GMRES iterations with the factored part. */

DGFEM_API dgfem_shell_static_desc dgfem_default_shell_static_desc(void) {
    dgfem_shell_static_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_SHELL_COOKIE;
    desc.load_steps = 1;
    desc.max_halvings = 6;
    desc.max_iterations = 40;
    desc.tolerance = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-3) : DGFEM_R(1e-8);
    desc.line_search = 1;
    desc.relaxation = DGFEM_R(0.5);
    return desc;
}

static dgfem_shell_info dgfem_shelli_empty_info(void) {
    dgfem_shell_info info;
    memset(&info, 0, sizeof info);
    info.failed_node = DGFEM_NONE;
    return info;
}

static dgfem_real dgfem_shelli_product(const dgfem_shell *shell, const dgfem_vec3 *a, const dgfem_vec3 *b) {
    dgfem_real sum = 0;
    for (int i = 0; i < shell->node_count; i++) sum += dgfem_shelli_dot(a[i], b[i]);
    return sum;
}

static dgfem_real dgfem_shelli_length(const dgfem_shell *shell, const dgfem_vec3 *a) {
    return dgfem_shelli_sqrt(dgfem_shelli_product(shell, a, a));
}

static size_t dgfem_shelli_bytes(const dgfem_shell *shell) { return (size_t)shell->node_count * sizeof(dgfem_vec3); }

/* ---- the linear system ---- */

/* Size of the diagonal blocks: what a shift is measured by. */
static dgfem_real dgfem_shelli_shift_diagonal(const dgfem_shell *shell, dgfem_real part) {
    dgfem_real *values = shell->system->matrix->values, largest = 0;
    for (int i = 0; i < shell->node_count; i++) {
        dgfem_real *block = values + shell->system->diagonal[i];
        dgfem_real size = (block[0] + block[4] + block[8]) / 3;
        largest = dgfem_shelli_max(largest, size);
        for (int k = 0; k < 9; k += 4) block[k] += part * size;
    }
    return largest;
}

static dgfem_status dgfem_shelli_factor(dgfem_shell *shell, dgfem_shell_info *info) {
    dgfem_cholesky_info factor;
    double start = dgfem_shelli_clock(&shell->hooks);
    dgfem_status status = dgfem_cholesky_factor(shell->system->cholesky, shell->system->matrix, &factor);
    info->failed_node = factor.failed_block;
    info->seconds_factor += dgfem_shelli_clock(&shell->hooks) - start;
    return status;
}

/* Factors, with a growing part of the diagonal added where the matrix is not positive definite: the step then still
   goes downhill. */
static dgfem_status dgfem_shelli_factor_shifted(dgfem_shell *shell, dgfem_shell_info *info) {
    dgfem_real part = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-5) : DGFEM_R(1e-8);
    dgfem_status status = dgfem_shelli_factor(shell, info);
    for (int k = 0; k < 8 && status == DGFEM_ERROR_NOT_POSITIVE_DEFINITE; k++, part *= 8) {
        (void)dgfem_shelli_shift_diagonal(shell, part);
        info->shifts++;
        status = dgfem_shelli_factor(shell, info);
    }
    return status;
}

static dgfem_status dgfem_shelli_solve(dgfem_shell *shell, const dgfem_vec3 *rhs, dgfem_vec3 *x,
                                       dgfem_shell_info *info) {
    double start = dgfem_shelli_clock(&shell->hooks);
    dgfem_status status =
        dgfem_cholesky_solve(shell->system->cholesky, dgfem_shelli_reals(rhs), dgfem_shelli_reals_of(x));
    info->seconds_solve += dgfem_shelli_clock(&shell->hooks) - start;
    for (int i = 0; !status && i < shell->node_count; i++)
        if (!dgfem_shelli_is_finite3(x[i])) status = DGFEM_ERROR_NOT_FINITE;
    return status;
}

/* ---- residual ---- */

/* How a solve stands. */
typedef struct dgfem_shelli_path {
    dgfem_real scale;     /* size of the forces that balance */
    dgfem_real stiffness; /* largest diagonal, for the round-off of forces */
    dgfem_real extent;    /* of the shell */
    dgfem_real reach;     /* what the round-off of positions is measured by */
    int search;           /* whether to search along the lines */
} dgfem_shelli_path;

/* r = F_ext - f_int at x, without the reactions of what is held; also sets the scale. */
static void dgfem_shelli_residual(const dgfem_shell *shell, const dgfem_vec3 *x, dgfem_shelli_path *path,
                                  dgfem_vec3 *r) {
    dgfem_vec3 *force = dgfem_shelli_vector(shell, DGFEM_SHELLI_FORCE);
    memset(force, 0, dgfem_shelli_bytes(shell));
    memset(r, 0, dgfem_shelli_bytes(shell));
    dgfem_shelli_add_external(shell, x, 0, 1, force);
    (void)dgfem_shelli_add_internal(shell, x, 0, 1, r);
    path->scale = dgfem_shelli_max(dgfem_shelli_length(shell, force), dgfem_shelli_length(shell, r));
    for (int i = 0; i < shell->node_count; i++) r[i] = dgfem_shelli_sub(force[i], r[i]);
    dgfem_shelli_hold_vector(shell, r);
}

/* Converged, by tolerance or because round-off allows no more. */
static int dgfem_shelli_converged(const dgfem_shelli_path *path, dgfem_real tolerance, dgfem_real residual) {
    dgfem_real floor = 4 * DGFEM_SHELL_EPSILON * path->stiffness * path->reach;
    return residual <= tolerance * path->scale || residual <= floor;
}

static dgfem_real dgfem_shelli_extent(const dgfem_shell *shell) {
    dgfem_real square = 0;
    for (int i = 0; i < shell->node_count; i++) {
        dgfem_vec3 d = dgfem_shelli_sub(shell->rest[i], shell->rest[0]);
        square = dgfem_shelli_max(square, dgfem_shelli_dot(d, d));
    }
    return dgfem_shelli_sqrt(square);
}

/* Size of the numbers that positions x and those of rest are made of: the extent and the distance from the origin. */
static dgfem_real dgfem_shelli_reach(const dgfem_shell *shell, const dgfem_vec3 *x, dgfem_real extent) {
    dgfem_real square = 0;
    for (int i = 0; i < shell->node_count; i++) {
        square = dgfem_shelli_max(square, dgfem_shelli_dot(x[i], x[i]));
        square = dgfem_shelli_max(square, dgfem_shelli_dot(shell->rest[i], shell->rest[i]));
    }
    return extent + dgfem_shelli_sqrt(square);
}

/* ---- one Newton iteration ---- */

/* The prescribed part of the next increment: what held directions lack. Returns its size. */
static dgfem_real dgfem_shelli_prescribed(const dgfem_shell *shell, const dgfem_vec3 *x, dgfem_vec3 *motion) {
    const dgfem_shell_system *system = shell->system;
    dgfem_real size = 0;
    for (int i = 0; i < shell->node_count; i++) {
        motion[i] = dgfem_shelli_vec3(0, 0, 0);
        if (!system->held[i]) continue;
        dgfem_vec3 lack = dgfem_shelli_sub(system->target[i], dgfem_shelli_sub(x[i], shell->rest[i]));
        motion[i] = dgfem_shelli_sub(lack, dgfem_shelli_multiply(&system->free_part[i], lack));
        size = dgfem_shelli_max(size, dgfem_shelli_norm(motion[i]));
    }
    return size;
}

/* Whether a load's derivative is not all in the symmetric matrix. */
static int dgfem_shelli_has_followers(const dgfem_shell *shell) {
    for (int c = 0; c < shell->condition_count; c++)
        if (dgfem_shelli_follows(shell, &shell->conditions[c])) return 1;
    return 0;
}

/* out = P (K_tangent v - dF_ext v), all of it; the loads by a difference. */
static void dgfem_shelli_full_product(const dgfem_shell *shell, const dgfem_vec3 *x, const dgfem_vec3 *v,
                                      dgfem_real extent, dgfem_vec3 *out) {
    dgfem_vec3 *ahead = dgfem_shelli_vector(shell, DGFEM_SHELLI_BEST);
    memset(out, 0, dgfem_shelli_bytes(shell));
    dgfem_shelli_add_tangent_product(shell, x, v, out);
    for (int c = 0; c < shell->condition_count; c++) {
        const dgfem_shell_condition *pin = &shell->conditions[c];
        if (pin->kind != DGFEM_SHELL_CONDITION_PIN) continue;
        for (int i = 0; i < pin->count; i++)
            out[pin->items[i]] = dgfem_shelli_axpy(out[pin->items[i]], pin->scalar, v[pin->items[i]]);
    }
    dgfem_real length = dgfem_shelli_length(shell, v);
    if (dgfem_shelli_has_followers(shell) && length > 0) {
        dgfem_real step = dgfem_shelli_sqrt(DGFEM_SHELL_EPSILON) * extent / length;
        for (int sign = -1; sign <= 1; sign += 2) {
            for (int i = 0; i < shell->node_count; i++)
                ahead[i] = dgfem_shelli_axpy(x[i], (dgfem_real)sign * step, v[i]);
            dgfem_shelli_add_followers(shell, ahead, (dgfem_real)-sign / (2 * step), out);
        }
    }
    dgfem_shelli_hold_vector(shell, out);
}

/* Improves y = K_sym^-1 b to the solution of K y = b by GMRES, K_sym being factored: y += sum c_k v_k with the smallest
   residual K_sym^-1 (b - K y). */
static dgfem_status dgfem_shelli_refine(dgfem_shell *shell, const dgfem_vec3 *x, dgfem_real extent, const dgfem_vec3 *b,
                                        dgfem_vec3 *y, dgfem_shell_info *info) {
    enum { STEPS = DGFEM_SHELLI_VECTORS - DGFEM_SHELLI_KRYLOV - 1 };
    dgfem_real h[STEPS + 1][STEPS], cosine[STEPS], sine[STEPS], g[STEPS + 1];
    dgfem_vec3 *work = dgfem_shelli_vector(shell, DGFEM_SHELLI_FORCE);
    dgfem_vec3 *v = dgfem_shelli_vector(shell, DGFEM_SHELLI_KRYLOV);
    const dgfem_real enough = DGFEM_R(1e-6) * dgfem_shelli_length(shell, y);
    int n = shell->node_count, steps = 0;
    dgfem_shelli_full_product(shell, x, y, extent, work);
    for (int i = 0; i < n; i++) work[i] = dgfem_shelli_sub(b[i], work[i]);
    dgfem_status status = dgfem_shelli_solve(shell, work, v, info);
    if (status) return status;
    dgfem_shelli_hold_vector(shell, v);
    g[0] = dgfem_shelli_length(shell, v);
    for (int i = 0; g[0] > 0 && i < n; i++) v[i] = dgfem_shelli_scale(1 / g[0], v[i]);
    while (steps < STEPS && dgfem_shelli_abs(g[steps]) > enough) {
        const int k = steps++;
        dgfem_vec3 *next = v + (size_t)(k + 1) * (size_t)n;
        dgfem_shelli_full_product(shell, x, v + (size_t)k * (size_t)n, extent, work);
        status = dgfem_shelli_solve(shell, work, next, info);
        if (status) return status;
        dgfem_shelli_hold_vector(shell, next);
        for (int j = 0; j <= k; j++) {
            const dgfem_vec3 *old = v + (size_t)j * (size_t)n;
            h[j][k] = dgfem_shelli_product(shell, old, next);
            for (int i = 0; i < n; i++) next[i] = dgfem_shelli_axpy(next[i], -h[j][k], old[i]);
        }
        h[k + 1][k] = dgfem_shelli_length(shell, next);
        for (int i = 0; h[k + 1][k] > 0 && i < n; i++) next[i] = dgfem_shelli_scale(1 / h[k + 1][k], next[i]);
        for (int j = 0; j < k; j++) {
            dgfem_real upper = h[j][k];
            h[j][k] = cosine[j] * upper + sine[j] * h[j + 1][k];
            h[j + 1][k] = cosine[j] * h[j + 1][k] - sine[j] * upper;
        }
        dgfem_real length = dgfem_shelli_sqrt(h[k][k] * h[k][k] + h[k + 1][k] * h[k + 1][k]);
        if (!(length > 0)) break;
        cosine[k] = h[k][k] / length, sine[k] = h[k + 1][k] / length;
        h[k][k] = length;
        g[k + 1] = -sine[k] * g[k], g[k] *= cosine[k];
    }
    for (int k = steps - 1; k >= 0; k--) { /* g becomes the coefficients */
        for (int j = k + 1; j < steps; j++) g[k] -= h[k][j] * g[j];
        if (!(dgfem_shelli_abs(h[k][k]) > 0)) return DGFEM_OK;
        g[k] /= h[k][k];
    }
    for (int k = 0; k < steps; k++)
        for (int i = 0; i < n; i++) y[i] = dgfem_shelli_axpy(y[i], g[k], v[(size_t)k * (size_t)n + (size_t)i]);
    return DGFEM_OK;
}

/* Solves for the increment at x: SOLUTION = MOTION + P K^-1 P (r - K MOTION). */
static dgfem_status dgfem_shelli_increment(dgfem_shell *shell, const dgfem_vec3 *x, int frozen, dgfem_shelli_path *path,
                                           int moves, int refine, dgfem_shell_info *info) {
    int shifts = info->shifts;
    const dgfem_vec3 *r = dgfem_shelli_vector(shell, DGFEM_SHELLI_RESIDUAL);
    dgfem_vec3 *motion = dgfem_shelli_vector(shell, DGFEM_SHELLI_MOTION);
    dgfem_vec3 *rhs = dgfem_shelli_vector(shell, DGFEM_SHELLI_RHS);
    dgfem_vec3 *solution = dgfem_shelli_vector(shell, DGFEM_SHELLI_SOLUTION);
    double start = dgfem_shelli_clock(&shell->hooks);
    dgfem_matrix_clear(shell->system->matrix);
    dgfem_shelli_assemble(shell, x, !frozen && shell->desc.corotational, 1, 1);
    dgfem_shelli_assemble_external(shell, x, !frozen, 1);
    path->stiffness = dgfem_shelli_shift_diagonal(shell, 0);
    memset(rhs, 0, dgfem_shelli_bytes(shell));
    if (moves) dgfem_matrix_multiply(shell->system->matrix, dgfem_shelli_reals(motion), dgfem_shelli_reals_of(rhs));
    for (int i = 0; i < shell->node_count; i++) rhs[i] = dgfem_shelli_sub(r[i], rhs[i]);
    dgfem_shelli_hold_vector(shell, rhs);
    dgfem_shelli_hold_matrix(shell);
    info->seconds_assemble += dgfem_shelli_clock(&shell->hooks) - start;
    dgfem_status status =
        shell->desc.corotational ? dgfem_shelli_factor_shifted(shell, info) : dgfem_shelli_factor(shell, info);
    if (!status) status = dgfem_shelli_solve(shell, rhs, solution, info);
    if (status) return status;
    dgfem_shelli_hold_vector(shell, solution);
    if (refine && !moves && info->shifts == shifts)
        status = dgfem_shelli_refine(shell, x, path->extent, rhs, solution, info);
    for (int i = 0; i < shell->node_count; i++) solution[i] = dgfem_shelli_add(solution[i], motion[i]);
    return status;
}

/* to = from + factor * SOLUTION */
static void dgfem_shelli_move(const dgfem_shell *shell, const dgfem_vec3 *from, dgfem_real factor, dgfem_vec3 *to) {
    const dgfem_vec3 *solution = dgfem_shelli_vector(shell, DGFEM_SHELLI_SOLUTION);
    for (int i = 0; i < shell->node_count; i++) to[i] = dgfem_shelli_axpy(from[i], factor, solution[i]);
}

/* Line search for a zero of the work g(s) = SOLUTION . r(x + s SOLUTION), by false position: a full step where that has
   fallen below `enough` of g(0). Leaves BEST and its residual. Full steps of a bending shell overshoot by far, for they
   stretch it, and yet converge faster: this is for where they do not converge. */
static void dgfem_shelli_search(const dgfem_shell *shell, const dgfem_vec3 *x, dgfem_shelli_path *path) {
    dgfem_vec3 *r = dgfem_shelli_vector(shell, DGFEM_SHELLI_RESIDUAL);
    dgfem_vec3 *best = dgfem_shelli_vector(shell, DGFEM_SHELLI_BEST);
    const dgfem_vec3 *solution = dgfem_shelli_vector(shell, DGFEM_SHELLI_SOLUTION);
    const dgfem_real enough = DGFEM_R(0.8);
    dgfem_real g0 = dgfem_shelli_product(shell, solution, r), low = 0, g_low = g0, high = 1;
    dgfem_shelli_move(shell, x, 1, best);
    dgfem_shelli_residual(shell, best, path, r);
    dgfem_real g_high = dgfem_shelli_product(shell, solution, r), s = 1;
    for (int k = 0; k < 6; k++) {
        dgfem_real g = s == high ? g_high : g_low;
        if (dgfem_shelli_abs(g) <= enough * dgfem_shelli_abs(g0) || !(g_low > 0) || (g_high > 0)) return;
        dgfem_real next = low + (high - low) * g_low / (g_low - g_high);
        if (!(next > low + DGFEM_R(0.1) * (high - low))) next = low + DGFEM_R(0.1) * (high - low);
        s = next;
        dgfem_shelli_move(shell, x, s, best);
        dgfem_shelli_residual(shell, best, path, r);
        g = dgfem_shelli_product(shell, solution, r);
        if (g < 0 || !dgfem_shelli_is_finite(g)) high = s, g_high = g;
        else low = s, g_low = g;
    }
}

/* Newton (or the fixed point) at one part of the path; x = X on entry and exit. */
static dgfem_status dgfem_shelli_iterate(dgfem_shell *shell, const dgfem_shell_static_desc *desc,
                                         dgfem_shelli_path *path, dgfem_shell_info *info) {
    dgfem_vec3 *x = dgfem_shelli_vector(shell, DGFEM_SHELLI_X), *r = dgfem_shelli_vector(shell, DGFEM_SHELLI_RESIDUAL);
    dgfem_vec3 *best = dgfem_shelli_vector(shell, DGFEM_SHELLI_BEST);
    for (int iteration = 0; iteration < desc->max_iterations; iteration++) {
        dgfem_real moved = dgfem_shelli_prescribed(shell, x, dgfem_shelli_vector(shell, DGFEM_SHELLI_MOTION));
        path->reach = dgfem_shelli_reach(shell, x, path->extent);
        int moves = moved > 10 * DGFEM_SHELL_EPSILON * path->reach;
        if (iteration == 0) dgfem_shelli_residual(shell, x, path, r);
        int refine = !desc->frozen && shell->desc.corotational && iteration >= 3;
        dgfem_status status = dgfem_shelli_increment(shell, x, desc->frozen, path, moves, refine, info);
        if (status) return status;
        info->iterations++;
        if (path->search && !moves && !desc->frozen && shell->desc.corotational) {
            dgfem_shelli_search(shell, x, path);
        } else {
            int whole = !desc->frozen || !shell->desc.corotational || iteration == 0;
            dgfem_shelli_move(shell, x, whole ? 1 : desc->relaxation, best);
            dgfem_shelli_residual(shell, best, path, r);
        }
        memcpy(x, best, dgfem_shelli_bytes(shell));
        dgfem_real residual = dgfem_shelli_length(shell, r);
        info->residual = path->scale > 0 ? residual / path->scale : 0;
        if (!dgfem_shelli_is_finite(residual)) return DGFEM_ERROR_NOT_CONVERGED;
        if (!shell->desc.corotational || dgfem_shelli_converged(path, desc->tolerance, residual)) return DGFEM_OK;
    }
    return DGFEM_ERROR_NOT_CONVERGED;
}

/* ---- load steps ---- */

/* Advances the path in steps, halving those that fail. */
static dgfem_status dgfem_shelli_follow_path(dgfem_shell *shell, const dgfem_shell_static_desc *desc,
                                             dgfem_shell_info *info) {
    dgfem_vec3 *x = dgfem_shelli_vector(shell, DGFEM_SHELLI_X), *good = dgfem_shelli_vector(shell, DGFEM_SHELLI_V);
    dgfem_shelli_path path;
    dgfem_real done = 0, step = 1 / (dgfem_real)desc->load_steps, smallest = step;
    for (int k = 0; k < desc->max_halvings; k++) smallest /= 2;
    memset(&path, 0, sizeof path);
    path.extent = dgfem_shelli_extent(shell);
    path.search = desc->line_search >= 2;
    memcpy(x, shell->position, dgfem_shelli_bytes(shell));
    while (done < 1) {
        memcpy(good, x, dgfem_shelli_bytes(shell));
        dgfem_real part = done + step < 1 - DGFEM_R(1e-6) ? done + step : 1;
        info->load_steps++;
        shell->system->part = part;
        dgfem_shelli_refresh_edges(shell);
        (void)dgfem_shelli_collect_held(shell);
        dgfem_status status = dgfem_shelli_iterate(shell, desc, &path, info);
        if (!status) {
            done = part;
            continue;
        }
        if (status == DGFEM_ERROR_MEMORY || !shell->desc.corotational || step / 2 < smallest * DGFEM_R(0.99))
            return status;
        memcpy(x, good, dgfem_shelli_bytes(shell));
        step /= 2;
        path.search = desc->line_search >= 1;
    }
    return DGFEM_OK;
}

static dgfem_status dgfem_shelli_check_static(const dgfem_shell *shell, const dgfem_shell_static_desc *desc) {
    const dgfem_hooks *hooks = &shell->hooks;
    if (!desc || desc->cookie != DGFEM_SHELL_COOKIE) return DGFEM_ERROR_DESCRIPTOR;
    if (desc->load_steps < 1 || desc->max_iterations < 1 || desc->max_halvings < 0 || desc->max_halvings > 30)
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "%d load steps, %d halvings, %d iterations",
                                 desc->load_steps, desc->max_halvings, desc->max_iterations);
    if (!(desc->relaxation > 0 && desc->relaxation <= 1))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "relaxation is %g, expected in (0, 1]",
                                 (double)desc->relaxation);
    return dgfem_shelli_check_scalar(hooks, desc->tolerance, 1, "tolerance");
}

DGFEM_API dgfem_status dgfem_shell_solve_static(dgfem_shell *shell, const dgfem_shell_static_desc *desc,
                                                dgfem_shell_info *info) {
    dgfem_shell_info local = dgfem_shelli_empty_info();
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_static(shell, desc);
    if (status) return status;
    if (!dgfem_shelli_collect_held(shell))
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_UNCONSTRAINED, "no node is held");
    status = dgfem_shelli_follow_path(shell, desc, &local);
    shell->system->part = 1;
    dgfem_shelli_refresh_edges(shell);
    if (info) *info = local;
    if (status)
        return dgfem_shelli_fail(&shell->hooks, status, "static solve: %d iterations, residual %g, node %d",
                                 local.iterations, (double)local.residual, local.failed_node);
    memcpy(shell->position, dgfem_shelli_vector(shell, DGFEM_SHELLI_X), dgfem_shelli_bytes(shell));
    memset(shell->velocity, 0, dgfem_shelli_bytes(shell));
    dgfem_shelli_settle(shell);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_is_stable(dgfem_shell *shell, int *stable) {
    dgfem_shell_info info = dgfem_shelli_empty_info();
    if (!shell || !stable) return DGFEM_ERROR_ARGUMENT;
    (void)dgfem_shelli_collect_held(shell);
    dgfem_matrix_clear(shell->system->matrix);
    dgfem_shelli_assemble(shell, shell->position, shell->desc.corotational, 1, 1);
    dgfem_shelli_assemble_external(shell, shell->position, 1, 1);
    dgfem_shelli_hold_matrix(shell);
    dgfem_status status = dgfem_shelli_factor(shell, &info);
    *stable = !status;
    return status == DGFEM_ERROR_NOT_POSITIVE_DEFINITE ? DGFEM_OK : status;
}
