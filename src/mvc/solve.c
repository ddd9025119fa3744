#pragma once
#include "load.c"
/* Moving a body: the time step and the static solve. */

static dgfem_mvc_info dgfem_mvci_empty_info(void) {
    dgfem_mvc_info info;
    memset(&info, 0, sizeof info);
    info.failed_node = DGFEM_NONE;
    return info;
}

/* Solves the system; x holds the start of an iteration. */
static dgfem_status dgfem_mvci_solve(dgfem_mvc *body, dgfem_vec3 *rhs, dgfem_vec3 *x, dgfem_mvc_info *info) {
    const dgfem_hooks *hooks = &body->hooks;
    double start = dgfem_mvci_clock(hooks);
    dgfem_status status;
    if (body->desc.solver == DGFEM_SOLVER_PCG) {
        dgfem_pcg_desc desc = dgfem_default_pcg_desc();
        dgfem_pcg_info pcg;
        memset(&pcg, 0, sizeof pcg);
        desc.tolerance = body->desc.solver_tolerance;
        desc.max_iterations = body->desc.solver_iterations;
        desc.work = body->system->pcg_work;
        desc.hooks = *hooks;
        desc.hooks.log = NULL;
        status = dgfem_pcg(body->system->matrix, &desc, dgfem_mvci_reals(rhs), dgfem_mvci_reals(x), &pcg);
        info->iterations += pcg.iterations;
        info->residual = pcg.residual;
        info->failed_node = pcg.failed_block;
        info->seconds_solve += dgfem_mvci_clock(hooks) - start;
    } else {
        dgfem_cholesky_info factor;
        memset(&factor, 0, sizeof factor);
        status = dgfem_cholesky_factor(body->system->cholesky, body->system->matrix, &factor);
        double middle = dgfem_mvci_clock(hooks);
        info->seconds_factor += middle - start;
        info->failed_node = factor.failed_block;
        body->system->factor_flops = factor.factor_flops;
        if (!status) status = dgfem_cholesky_solve(body->system->cholesky, dgfem_mvci_reals(rhs), dgfem_mvci_reals(x));
        info->seconds_solve += dgfem_mvci_clock(hooks) - middle;
    }
    if (status)
        return dgfem_mvci_fail(hooks, status, "linear system: node %d, residual %g after %d iterations",
                               info->failed_node, (double)info->residual, info->iterations);
    for (int i = 0; i < body->node_count; i++)
        if (!dgfem_mvci_is_finite3(x[i]))
            return dgfem_mvci_fail(hooks, DGFEM_ERROR_NOT_FINITE, "solution at node %d", i);
    return DGFEM_OK;
}

/* ---- time step ---- */

/* System of one step: (M + h D + h^2 K) v+ = M v + h (F - f), D = alpha M + beta K; contact added. */
static void dgfem_mvci_assemble_step(dgfem_mvc *body, dgfem_real h, dgfem_vec3 *rhs, dgfem_mvc_info *info) {
    const dgfem_mvc_system *system = body->system;
    dgfem_vec3 *force = dgfem_mvci_vector(body, DGFEM_MVCI_FORCE);
    double start = dgfem_mvci_clock(&body->hooks);
    dgfem_mvci_rotations(body, system->next);
    dgfem_mvci_assemble_stiffness(body, system->next, h * h + h * body->desc.damping_stiffness);
    dgfem_mvci_forces(body, system->next, force);
    for (int i = 0; i < body->node_count; i++) {
        dgfem_real mass = body->mass[i], *block = system->matrix->values + system->diagonal[i];
        rhs[i] = dgfem_mvci_blend(mass, body->velocity[i], -h, force[i]);
        for (int k = 0; k < 9; k += 4) block[k] += (1 + h * body->desc.damping_mass) * mass;
    }
    dgfem_mvci_add_external(body, h, rhs);
    dgfem_mvci_assemble_pins(body, h * h, h, rhs);
    double middle = dgfem_mvci_clock(&body->hooks);
    info->seconds_assemble += middle - start;
    info->contacts = dgfem_mvci_assemble_contact(body, h, rhs);
    info->seconds_contact += dgfem_mvci_clock(&body->hooks) - middle;
}

static void dgfem_mvci_commit_rotations(dgfem_mvc *body) {
    memcpy(body->rotation, body->system->next, (size_t)body->element_count * sizeof *body->rotation);
}

static dgfem_status dgfem_mvci_step(dgfem_mvc *body, dgfem_real h, dgfem_mvc_info *info) {
    dgfem_vec3 *rhs = dgfem_mvci_vector(body, DGFEM_MVCI_RHS), *v = dgfem_mvci_vector(body, DGFEM_MVCI_SOLUTION);
    size_t size = (size_t)body->node_count * sizeof *v;
    dgfem_status status = dgfem_mvci_prepare_solver(body, 1);
    if (!status) status = dgfem_mvci_collect_held(body, 1);
    if (status) return status;
    dgfem_mvci_assemble_step(body, h, rhs, info);
    memcpy(v, body->velocity, size);
    dgfem_mvci_hold_vector(body, h, v);
    dgfem_mvci_hold_matrix(body, v, rhs);
    status = dgfem_mvci_solve(body, rhs, v, info);
    if (status) return status;
    dgfem_mvci_hold_vector(body, h, v); /* exactly, whatever the solver */
    memcpy(body->velocity, v, size);
    for (int i = 0; i < body->node_count; i++) body->position[i] = dgfem_mvci_axpy(body->position[i], h, v[i]);
    dgfem_mvci_commit_rotations(body);
    body->time += (double)h;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_step(dgfem_mvc *body, dgfem_real dt, dgfem_mvc_info *info) {
    dgfem_mvc_info local = dgfem_mvci_empty_info();
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_check_scalar(&body->hooks, dt, 1, "dt");
    if (!status) status = dgfem_mvci_step(body, dt, &local);
    if (info) *info = local;
    return status;
}

/* ---- what holds the body ---- */

/* root[i]: the lowest node that hangs together with node i. */
static void dgfem_mvci_node_pieces(const dgfem_mvc *body, int *root) {
    const dgfem_mvc_system *system = body->system;
    for (int i = 0; i < body->node_count; i++) root[i] = i;
    for (int e = 0; e < body->element_count; e++)
        for (int k = system->node_start[e]; k < system->node_start[e + 1]; k++)
            dgfem_mvci_join(root, system->nodes[system->node_start[e]], system->nodes[k]);
    for (int i = 0; i < body->node_count; i++) root[i] = dgfem_mvci_root(root, i);
}

/* The conditions on the rigid motions t + w x (x - centre) / size of one piece, as a Gram matrix over (t, w): a motion
   that no condition sees is in its kernel. */
typedef struct dgfem_mvci_hold {
    dgfem_vec3 lower, upper;
    double gram[6][6];
} dgfem_mvci_hold;

/* The axis of a node at x is held. */
static void dgfem_mvci_hold_axis(dgfem_mvci_hold *hold, dgfem_vec3 x, int axis) {
    dgfem_vec3 centre = dgfem_mvci_scale(DGFEM_R(0.5), dgfem_mvci_add(hold->lower, hold->upper));
    dgfem_vec3 e = dgfem_mvci_vec3((dgfem_real)(axis == 0), (dgfem_real)(axis == 1), (dgfem_real)(axis == 2));
    dgfem_vec3 turn = dgfem_mvci_cross(dgfem_mvci_sub(x, centre), e);
    double size = (double)dgfem_mvci_distance(hold->lower, hold->upper), row[6];
    row[0] = axis == 0, row[1] = axis == 1, row[2] = axis == 2;
    row[3] = (double)turn.x / size, row[4] = (double)turn.y / size, row[5] = (double)turn.z / size;
    for (int i = 0; i < 36; i++) hold->gram[i / 6][i % 6] += row[i / 6] * row[i % 6];
}

/* Cholesky. The bound lets a node hold a body of 1e5 times its distance, and is far above round-off in float. */
static int dgfem_mvci_hold_is_complete(dgfem_mvci_hold *hold) {
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

static void dgfem_mvci_extend(dgfem_vec3 *lower, dgfem_vec3 *upper, dgfem_vec3 x) {
    if (x.x < lower->x) lower->x = x.x;
    if (x.y < lower->y) lower->y = x.y;
    if (x.z < lower->z) lower->z = x.z;
    if (x.x > upper->x) upper->x = x.x;
    if (x.y > upper->y) upper->y = x.y;
    if (x.z > upper->z) upper->z = x.z;
}

/* Refuses a body of which a piece is free to move as a rigid one, to first order about its rest position. Needs the
   held axes collected. */
static dgfem_status dgfem_mvci_check_held(const dgfem_mvc *body) {
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&body->hooks);
    int *root = (int *)dgfem_mvci_take(&scratch, (size_t)body->node_count, sizeof(int));
    dgfem_mvci_hold *holds = (dgfem_mvci_hold *)dgfem_mvci_take(&scratch, (size_t)body->node_count, sizeof *holds);
    dgfem_status status = root && holds ? DGFEM_OK : dgfem_mvci_fail_memory(&body->hooks);
    if (!status) dgfem_mvci_node_pieces(body, root);
    for (int i = 0; !status && i < body->node_count; i++) {
        dgfem_mvci_hold *hold = &holds[root[i]];
        if (root[i] == i) hold->lower = hold->upper = body->rest[i];
        dgfem_mvci_extend(&hold->lower, &hold->upper, body->rest[i]);
    }
    for (int i = 0; !status && i < body->node_count; i++)
        for (int axis = 0; axis < 3; axis++)
            if (body->system->held[i] >> axis & 1) dgfem_mvci_hold_axis(&holds[root[i]], body->rest[i], axis);
    for (int c = 0; !status && c < body->condition_count; c++) {
        const dgfem_mvc_condition *pin = &body->conditions[c];
        for (int i = 0; pin->kind == DGFEM_MVC_CONDITION_PIN && pin->scalar > 0 && i < pin->count; i++)
            for (int axis = 0; axis < 3; axis++)
                dgfem_mvci_hold_axis(&holds[root[pin->items[i]]], body->rest[pin->items[i]], axis);
    }
    for (int i = 0; !status && i < body->node_count; i++)
        if (root[i] == i && !dgfem_mvci_hold_is_complete(&holds[i]))
            status = dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_UNCONSTRAINED,
                                     "static solve: the conditions leave the piece of node %d free to move or turn", i);
    dgfem_mvci_scratch_free(&scratch);
    return status;
}

/* ---- static solve ---- */

static double dgfem_mvci_square_sum(const dgfem_vec3 *a, const dgfem_vec3 *b, int count) {
    double sum = 0;
    for (int i = 0; i < count; i++) {
        double x = (double)a[i].x - (double)b[i].x, y = (double)a[i].y - (double)b[i].y;
        double z = (double)a[i].z - (double)b[i].z;
        sum += x * x + y * y + z * z;
    }
    return sum;
}

/* One correction, K_w d = factor F - f(x), with the rotations of the current positions. info->residual becomes |d| over
   the displacement's size. Solving for the correction makes errors of the solver vanish with it. */
static dgfem_status dgfem_mvci_static_sweep(dgfem_mvc *body, dgfem_real factor, dgfem_mvc_info *info) {
    const dgfem_mvc_system *system = body->system;
    dgfem_vec3 *rhs = dgfem_mvci_vector(body, DGFEM_MVCI_RHS), *d = dgfem_mvci_vector(body, DGFEM_MVCI_SOLUTION);
    dgfem_vec3 *force = dgfem_mvci_vector(body, DGFEM_MVCI_FORCE);
    size_t size = (size_t)body->node_count * sizeof *d;
    double start = dgfem_mvci_clock(&body->hooks);
    dgfem_mvci_rotations(body, system->next);
    dgfem_mvci_assemble_stiffness(body, system->next, 1);
    dgfem_mvci_forces(body, system->next, force);
    for (int i = 0; i < body->node_count; i++) rhs[i] = dgfem_mvci_scale(-1, force[i]);
    dgfem_mvci_add_external(body, factor, rhs);
    dgfem_mvci_assemble_pins(body, 1, 1, rhs);
    memset(d, 0, size);
    dgfem_mvci_hold_vector(body, 1, d);
    dgfem_mvci_hold_matrix(body, d, rhs);
    info->seconds_assemble += dgfem_mvci_clock(&body->hooks) - start;
    dgfem_status status = dgfem_mvci_solve(body, rhs, d, info);
    if (status) return status;
    dgfem_mvci_hold_vector(body, 1, d);
    memset(force, 0, size);
    double change = dgfem_mvci_square_sum(d, force, body->node_count);
    for (int i = 0; i < body->node_count; i++) body->position[i] = dgfem_mvci_add(body->position[i], d[i]);
    double whole = dgfem_mvci_square_sum(body->position, body->rest, body->node_count);
    info->residual = whole > 0 ? (dgfem_real)sqrt(change / whole) : 0;
    dgfem_mvci_commit_rotations(body);
    info->sweeps++;
    return DGFEM_OK;
}

static dgfem_status dgfem_mvci_static_load(dgfem_mvc *body, const dgfem_mvc_static_desc *desc, dgfem_real factor,
                                           dgfem_mvc_info *info) {
    dgfem_status status = dgfem_mvci_collect_held(body, factor);
    for (int sweep = 0; !status && sweep < desc->max_sweeps; sweep++) {
        status = dgfem_mvci_static_sweep(body, factor, info);
        if (!status && info->residual <= desc->tolerance) return DGFEM_OK;
    }
    if (status) return status;
    return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_NOT_CONVERGED,
                           "static solve at %g of the load: the displacement still changes by %g after %d sweeps",
                           (double)factor, (double)info->residual, desc->max_sweeps);
}

static dgfem_status dgfem_mvci_solve_static(dgfem_mvc *body, const dgfem_mvc_static_desc *desc, dgfem_mvc_info *info) {
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&body->hooks);
    size_t nodes = (size_t)body->node_count, elements = (size_t)body->element_count;
    dgfem_vec3 *position = (dgfem_vec3 *)dgfem_mvci_take(&scratch, nodes, sizeof *position);
    dgfem_mat3 *rotation = (dgfem_mat3 *)dgfem_mvci_take(&scratch, elements, sizeof *rotation);
    dgfem_status status = position && rotation ? DGFEM_OK : dgfem_mvci_fail_memory(&body->hooks);
    if (!status) {
        memcpy(position, body->position, nodes * sizeof *position);
        memcpy(rotation, body->rotation, elements * sizeof *rotation);
        for (int step = 1; !status && step <= desc->load_steps; step++)
            status = dgfem_mvci_static_load(body, desc, (dgfem_real)step / (dgfem_real)desc->load_steps, info);
        if (status) {
            memcpy(body->position, position, nodes * sizeof *position);
            memcpy(body->rotation, rotation, elements * sizeof *rotation);
        } else {
            memset(body->velocity, 0, nodes * sizeof *body->velocity);
        }
    }
    dgfem_mvci_scratch_free(&scratch);
    return status;
}

DGFEM_API dgfem_mvc_static_desc dgfem_default_mvc_static_desc(void) {
    dgfem_mvc_static_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_MVC_COOKIE;
    desc.load_steps = 1;
    desc.max_sweeps = 60;
    desc.tolerance = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-9);
    return desc;
}

DGFEM_API dgfem_status dgfem_mvc_solve_static(dgfem_mvc *body, const dgfem_mvc_static_desc *desc,
                                              dgfem_mvc_info *info) {
    dgfem_mvc_info local = dgfem_mvci_empty_info();
    dgfem_mvc_static_desc standard = dgfem_default_mvc_static_desc();
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!desc) desc = &standard;
    if (desc->cookie != DGFEM_MVC_COOKIE) return DGFEM_ERROR_DESCRIPTOR;
    dgfem_status status = dgfem_mvci_check_scalar(&body->hooks, desc->tolerance, 1, "tolerance");
    if (!status && (desc->load_steps < 1 || desc->max_sweeps < 1))
        status = dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "%d load_steps, %d max_sweeps", desc->load_steps,
                                 desc->max_sweeps);
    if (!status) status = dgfem_mvci_collect_held(body, 1);
    if (!status) status = dgfem_mvci_check_held(body);
    if (!status) status = dgfem_mvci_prepare_solver(body, 1);
    if (!status) status = dgfem_mvci_solve_static(body, desc, &local);
    if (info) *info = local;
    return status;
}
