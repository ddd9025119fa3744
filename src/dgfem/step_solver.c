#pragma once
#include "cholesky.c"
#include "pcg.c"
#include "warp.c"
/* The linear system of a time step, solved for the velocities by conjugate gradients with an earlier factorization.

   Warping turns the stiffness of an element and hardly changes it otherwise. So the matrix A0 that an earlier step
   factored, turned with the elements, is near today's matrix A. With T the rotations of all elements since then,

       P = T A0 T^T,   P^-1 r = T (A0^-1 (T^T r)),

   and conjugate gradients preconditioned by P need one to three iterations, until neighbours have turned much against
   each other or contact has changed much. The iteration starts from the velocity of now, moved along its change in the
   last step so far as lowers the error's energy most. At the end the error that is left is made orthogonal to
   translations of each piece: what falls keeps its momentum to round-off, however coarse the tolerance.

   When to factor again is a choice between rent and purchase: the iterations beyond the first of each step are paid
   until they have cost as much as a factorization, then that is bought. So no step sequence costs more than twice what
   the better choice would have. Both are counted in operations, not measured, so that runs repeat bit for bit. */

struct dgfem_step_solver {
    int is_factored;         /* the body's factor is of the matrix of an earlier step */
    double factor_work;      /* of a factorization, */
    double iteration_work;   /* and of an iteration, in operations at the speed of an iteration */
    double rent;             /* work of iterations beyond each step's first since the factorization */
    dgfem_mat3 *rotation;    /* [elements] at the factorization */
    dgfem_mat3 *turn;        /* [elements] from then to now */
    dgfem_vec3 *change;      /* [basis functions] of the velocity in the last step; zero at first */
    dgfem_real *vectors;     /* [DGFEMI_STEP_VECTORS * unknowns] */
    int *piece;              /* [elements] the piece each belongs to: elements connected by glue */
    int piece_count;
    dgfem_real *gram;        /* [9 * pieces] A, restricted to translations of a piece */
    dgfem_vec3 *imbalance;   /* [pieces] the residual, likewise */
};

/* Work vectors: those of the iteration, the residual turned back to A0, and 1 / (diagonal of A). */
enum { DGFEMI_STEP_R, DGFEMI_STEP_Z, DGFEMI_STEP_P, DGFEMI_STEP_Q, DGFEMI_STEP_TURNED, DGFEMI_STEP_WEIGHT,
       DGFEMI_STEP_VECTORS };

/* Dense kernels of a factorization are so much faster than solves, which wait for memory. */
#define DGFEM_FACTOR_SPEED 8.

static void dgfemi_step_solver_destroy(dgfem_step_solver *solver, const dgfem_hooks *hooks) {
    if (!solver) return;
    dgfemi_free(hooks, solver->rotation);
    dgfemi_free(hooks, solver->turn);
    dgfemi_free(hooks, solver->change);
    dgfemi_free(hooks, solver->vectors);
    dgfemi_free(hooks, solver->piece);
    dgfemi_free(hooks, solver->gram);
    dgfemi_free(hooks, solver->imbalance);
    dgfemi_free(hooks, solver);
}

/* 0 when out of memory. */
static int dgfemi_step_solver_find_pieces(dgfem_step_solver *solver, const dgfem_mesh *mesh, const dgfem_hooks *hooks) {
    size_t elements = (size_t)mesh->element_count;
    int *stack = (int *)dgfemi_allocate(hooks, elements, sizeof(int));
    solver->piece = (int *)dgfemi_allocate(hooks, elements, sizeof(int));
    if (stack && solver->piece) solver->piece_count = dgfemi_mesh_pieces(mesh, solver->piece, stack);
    dgfemi_free(hooks, stack);
    if (solver->piece_count == 0) return 0;
    solver->gram = (dgfem_real *)dgfemi_allocate(hooks, 9 * (size_t)solver->piece_count, sizeof(dgfem_real));
    solver->imbalance = (dgfem_vec3 *)dgfemi_allocate(hooks, (size_t)solver->piece_count, sizeof(dgfem_vec3));
    return solver->gram && solver->imbalance;
}

/* NULL when out of memory. */
static dgfem_step_solver *dgfemi_step_solver_create(const dgfem_mesh *mesh, const dgfem_matrix *matrix,
                                                    const dgfem_cholesky *cholesky, const dgfem_hooks *hooks) {
    dgfem_step_solver *solver = (dgfem_step_solver *)dgfemi_allocate_zero(hooks, 1, sizeof *solver);
    size_t elements = (size_t)matrix->block_count, size = (size_t)matrix->size;
    if (!solver) return NULL;
    solver->rotation = (dgfem_mat3 *)dgfemi_allocate(hooks, elements, sizeof(dgfem_mat3));
    solver->turn = (dgfem_mat3 *)dgfemi_allocate(hooks, elements, sizeof(dgfem_mat3));
    solver->change = (dgfem_vec3 *)dgfemi_allocate_zero(hooks, size / 3, sizeof(dgfem_vec3));
    solver->vectors = (dgfem_real *)dgfemi_allocate(hooks, DGFEMI_STEP_VECTORS * size, sizeof(dgfem_real));
    if (!solver->rotation || !solver->turn || !solver->change || !solver->vectors ||
        !dgfemi_step_solver_find_pieces(solver, mesh, hooks)) {
        dgfemi_step_solver_destroy(solver, hooks);
        return NULL;
    }
    solver->factor_work = cholesky->factor_flops / DGFEM_FACTOR_SPEED;
    solver->iteration_work =
        4 * (cholesky->factor_entries + (double)matrix->value_start[matrix->row_start[elements]]);
    return solver;
}

static dgfem_real *dgfemi_step_vector(const dgfem_step_solver *solver, const dgfem_matrix *matrix, int k) {
    return solver->vectors + (size_t)k * (size_t)matrix->size;
}

/* ---- the preconditioner ---- */

/* to = T from, or T^T from */
static void dgfemi_turn_elements(const dgfem_body *body, int transposed, const dgfem_real *from, dgfem_real *to) {
    const dgfem_vec3 *in = (const dgfem_vec3 *)(const void *)from;
    dgfem_vec3 *out = (dgfem_vec3 *)(void *)to;
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfem_mat3 turn = body->step_solver->turn[e];
        if (transposed) turn = dgfemi_transposed(&turn);
        for (int i = body->basis_start[e]; i < body->basis_start[e + 1]; i++) out[i] = dgfemi_multiply(&turn, in[i]);
    }
}

static void dgfemi_apply_factor(void *context, const dgfem_real *r, dgfem_real *z) {
    const dgfem_body *body = (const dgfem_body *)context;
    dgfem_real *turned = dgfemi_step_vector(body->step_solver, body->matrix, DGFEMI_STEP_TURNED);
    dgfemi_turn_elements(body, 1, r, turned);
    dgfemi_solve(body->cholesky, 1, turned, turned);
    dgfemi_turn_elements(body, 0, turned, z);
}

static void dgfemi_find_turns(dgfem_body *body, const dgfem_mat3 *rotation) {
    dgfem_step_solver *solver = body->step_solver;
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfem_mat3 back = dgfemi_transposed(&solver->rotation[e]);
        solver->turn[e] = dgfemi_multiply3(&rotation[e], &back);
    }
}

static dgfem_status dgfemi_factor_step(dgfem_body *body, const dgfem_mat3 *rotation, dgfem_step_info *info) {
    dgfem_step_solver *solver = body->step_solver;
    double start = dgfemi_clock(&body->hooks);
    dgfem_cholesky_info factor;
    solver->is_factored = 0;
    dgfem_status status = dgfem_cholesky_factor(body->cholesky, body->matrix, &factor);
    info->seconds_factor += dgfemi_clock(&body->hooks) - start;
    info->failed_element = factor.failed_block;
    info->factorizations++;
    if (status) return status;
    memcpy(solver->rotation, rotation, (size_t)body->mesh->element_count * sizeof *rotation);
    solver->is_factored = 1;
    solver->rent = 0;
    return DGFEM_OK;
}

/* ---- iteration ---- */

static void dgfemi_weigh_by_diagonal(const dgfem_matrix *matrix, dgfem_real *weight) {
    for (int r = 0; r < matrix->block_count; r++) {
        int n = dgfemi_block_size(matrix, r);
        const dgfem_real *block = matrix->values + matrix->value_start[dgfemi_diagonal_index(matrix, r)];
        for (int i = 0; i < n; i++) weight[matrix->offset[r] + i] = 1 / block[i * (n + 1)];
    }
}

/* sqrt(r . W r), W diagonal */
static double dgfemi_weighted_norm(int count, const dgfem_real *weight, const dgfem_real *r) {
    double sum = 0;
    for (int i = 0; i < count; i++) sum += (double)weight[i] * (double)r[i] * (double)r[i];
    return sqrt(sum);
}

/* The speed of a velocity field, as the root of its mean square over the mass. */
static double dgfemi_mean_speed(const dgfem_body *body, const dgfem_real *v) {
    double mass = 0;
    for (int e = 0; e < body->mesh->element_count; e++)
        mass += (double)(body->material[e].density * dgfemi_form_mass(body->forms, e)[0]);
    return sqrt(dgfemi_mass_norm(body, (const dgfem_vec3 *)(const void *)v) / mass);
}

/* What a velocity's error is measured by: the mean speed, or a hundredth of an element's radius in a step if that is
   more. So a body comes to rest. */
static double dgfemi_reference_speed(const dgfem_body *body, dgfem_real h, const dgfem_real *v) {
    double radius = 0;
    for (int e = 0; e < body->mesh->element_count; e++) radius += (double)body->scale[e];
    double speed = dgfemi_mean_speed(body, v), least = 0.01 * radius / body->mesh->element_count / (double)h;
    return speed > least ? speed : least;
}

/* Moves x along the velocity's last change, so far as lowers the error's energy most. */
static void dgfemi_extrapolate(const dgfem_body *body, dgfemi_pcg *cg) {
    memcpy(cg->p, body->step_solver->change, (size_t)cg->matrix->size * sizeof *cg->p);
    double descent = dgfemi_vector_dot(cg->matrix->size, cg->p, cg->r);
    if (descent != 0) (void)dgfemi_pcg_advance(cg, descent);
}

/* Iterates until the error of x, as a mean speed, is below `target`, but at most `limit` times. The error is estimated
   from the last change of x, continued as a geometric series by the ratio at which the residual has shrunk of late.
   Returns 1 when x is good enough, 0 at the limit or on breakdown. */
static int dgfemi_iterate_step(const dgfem_body *body, dgfemi_pcg *cg, double target, int limit,
                               dgfem_step_info *info) {
    enum { MEMORY = 4 };
    const double slowest = 0.97;
    const dgfem_real *weight = dgfemi_step_vector(body->step_solver, cg->matrix, DGFEMI_STEP_WEIGHT);
    double history[MEMORY], last = 0;
    history[0] = dgfemi_weighted_norm(cg->matrix->size, weight, cg->r);
    if (history[0] == 0) return 1;
    for (int k = 1; k <= limit; k++) {
        int back = k < MEMORY ? k : MEMORY;
        if (!dgfemi_pcg_turn(cg, last) || !dgfemi_pcg_advance(cg, cg->rho)) return 0;
        info->iterations++;
        double residual = dgfemi_weighted_norm(cg->matrix->size, weight, cg->r);
        double ratio = pow(residual / history[(k - back) % MEMORY], 1. / back);
        if (!(ratio < slowest)) ratio = slowest;
        double error = (double)dgfemi_abs(cg->step) * dgfemi_mean_speed(body, cg->p) * ratio / (1 - ratio);
        if (!(error - error == 0)) return 0;
        info->residual = (dgfem_real)(error / target) * body->desc.velocity_tolerance;
        if (error <= target) return 1;
        history[k % MEMORY] = residual;
        last = cg->rho;
    }
    return 0;
}

/* A on the translations of each piece: the functions number 0 are 1 in their elements. */
static void dgfemi_gather_gram(const dgfem_body *body) {
    const dgfem_matrix *matrix = body->matrix;
    dgfem_step_solver *solver = body->step_solver;
    memset(solver->gram, 0, 9 * (size_t)solver->piece_count * sizeof *solver->gram);
    for (int r = 0; r < matrix->block_count; r++) {
        dgfem_real *gram = solver->gram + 9 * (size_t)solver->piece[r];
        for (int k = matrix->row_start[r]; k < matrix->row_start[r + 1]; k++) {
            int columns = dgfemi_block_size(matrix, matrix->column[k]);
            const dgfem_real *block = matrix->values + matrix->value_start[k];
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++) {
                    gram[3 * i + j] += block[i * columns + j];
                    if (matrix->column[k] != r) gram[3 * j + i] += block[i * columns + j];
                }
        }
    }
}

/* Moves each piece as a whole so that the residual has no resultant. */
static void dgfemi_balance_pieces(const dgfem_body *body, const dgfemi_pcg *cg) {
    dgfem_step_solver *solver = body->step_solver;
    dgfem_vec3 *x = (dgfem_vec3 *)(void *)cg->x;
    const dgfem_vec3 *r = (const dgfem_vec3 *)(const void *)cg->r;
    dgfemi_gather_gram(body);
    memset(solver->imbalance, 0, (size_t)solver->piece_count * sizeof *solver->imbalance);
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfem_vec3 *sum = &solver->imbalance[solver->piece[e]];
        *sum = dgfemi_add(*sum, r[body->basis_start[e]]);
    }
    for (int k = 0; k < solver->piece_count; k++) {
        dgfem_real *shift = (dgfem_real *)(void *)&solver->imbalance[k], *gram = solver->gram + 9 * (size_t)k;
        if (dgfemi_cholesky_dense(gram, 3)) dgfemi_cholesky_dense_solve(gram, 3, shift, 1);
        else memset(shift, 0, 3 * sizeof *shift);
    }
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfem_vec3 *v = &x[body->basis_start[e]];
        *v = dgfemi_add(*v, solver->imbalance[solver->piece[e]]);
    }
}

/* Solves matrix * v = rhs for the velocities at the end of a step of length h; v holds those at its beginning.
   `rotation` are the elements' rotations that the matrix was assembled with. */
static dgfem_status dgfemi_solve_step(dgfem_body *body, dgfem_real h, const dgfem_mat3 *rotation,
                                      const dgfem_real *rhs, dgfem_real *v, dgfem_step_info *info) {
    dgfem_step_solver *solver = body->step_solver;
    const dgfem_matrix *matrix = body->matrix;
    double factor_before = info->seconds_factor, start = dgfemi_clock(&body->hooks);
    double target = (double)body->desc.velocity_tolerance * dgfemi_reference_speed(body, h, v);
    double affordable = solver->factor_work / solver->iteration_work;
    int limit = affordable < 1000 ? 2 + (int)affordable : 1000, good = 0;
    dgfem_status status = DGFEM_OK;
    dgfemi_pcg cg;
    memset(&cg, 0, sizeof cg);
    cg.matrix = matrix, cg.b = rhs, cg.x = v;
    cg.preconditioner.apply = dgfemi_apply_factor;
    cg.preconditioner.context = body;
    cg.r = dgfemi_step_vector(solver, matrix, DGFEMI_STEP_R);
    cg.z = dgfemi_step_vector(solver, matrix, DGFEMI_STEP_Z);
    cg.p = dgfemi_step_vector(solver, matrix, DGFEMI_STEP_P);
    cg.q = dgfemi_step_vector(solver, matrix, DGFEMI_STEP_Q);
    dgfemi_weigh_by_diagonal(matrix, dgfemi_step_vector(solver, matrix, DGFEMI_STEP_WEIGHT));
    dgfemi_pcg_residual(&cg);
    dgfemi_extrapolate(body, &cg);
    if (solver->is_factored && solver->rent <= solver->factor_work) {
        int before = info->iterations;
        dgfemi_find_turns(body, rotation);
        good = dgfemi_iterate_step(body, &cg, target, limit, info);
        solver->rent += (info->iterations - before - 1) * solver->iteration_work;
    }
    if (!good) {
        status = dgfemi_factor_step(body, rotation, info);
        if (!status) {
            dgfemi_find_turns(body, rotation);
            memcpy(v, body->velocity, (size_t)matrix->size * sizeof *v);
            dgfemi_pcg_residual(&cg);
            (void)dgfemi_iterate_step(body, &cg, target, 1, info);
        }
    }
    if (!status) dgfemi_balance_pieces(body, &cg);
    info->seconds_solve += dgfemi_clock(&body->hooks) - start - (info->seconds_factor - factor_before);
    return status;
}
