#pragma once
#include "cholesky.c"
#include "contact.c"
#include "ssor.c"
#include "warp.c"
/* The linear system of a time step, solved for the velocities by conjugate gradients.

   Warping turns the stiffness of an element and hardly changes it otherwise. So the matrix A0 that an earlier step
   factored, turned with the elements, is near today's matrix A. With T the rotations of all elements since then,

       P = T A0 T^T,   P^-1 r = T (A0^-1 (T^T r)),

   and conjugate gradients preconditioned by P need one to three iterations, until neighbours have turned much against
   each other. Contact is stiff and changes from step to step, but only in diagonal blocks of the elements that touch:
   these are swept over before and after (a symmetric multiplicative Schwarz method). As long as there is no
   factorization, as after a cut, Gauss-Seidel sweeps are the preconditioner (ssor.c): they need ten times the
   iterations, but nothing is to be made for them.

   The iteration starts from the velocity of now, moved along its changes in the last few steps so far as lowers the
   error's energy most (Fischer 1998): they cost a product each, and an iteration with a factorization ten times that.
   At the end the error that is left is made orthogonal to translations of each piece: what falls keeps its momentum to
   round-off, however coarse the tolerance.

   When to factor again is a choice between rent and purchase: iterations with a factorization beyond the first of
   each step, and sweeps in its place, are paid until they have cost as much as a new one; then that is bought. So no
   sequence of steps costs much more than twice what the better choice would have. Whether sweeps alone are cheaper,
   as in soft bodies, and where elements snap through and no factorization lasts, is known from what the steps of
   either kind have cost on average; now and then the other kind is tried again. Work is counted in operations, not
   measured, so that runs repeat bit for bit. */

enum { DGFEM_PAST = 2 }; /* with one more hardly any iteration is saved */

struct dgfem_step_solver {
    int is_factored;        /* the body's factor is of the matrix of an earlier step */
    double factor_work;     /* of a factorization, in operations at the speed of an iteration, */
    double solve_work;      /* of an iteration with it, */
    double sweep_work;      /* and of one with sweeps */
    double rent;            /* paid since the last factorization */
    double stale_cost;      /* work of a step with a factorization, new ones included, on average; */
    double sweeps_cost;     /* that of a step with sweeps; 0: not known */
    dgfem_mat3 *rotation;   /* [elements] at the factorization */
    dgfem_mat3 *turn;       /* [elements] from then to now */
    char *touched;          /* [elements] 1 for those that touched something at the factorization */
    char *in_patch;         /* [elements] 1 for those that touched something then or touch something now, */
    int *patch;             /* [elements] and their list, ascending */
    int patch_count;
    dgfem_real *past[DGFEM_PAST]; /* [unknowns] changes of the velocity in steps before the last, the latest first */
    int past_count;
    dgfem_real *vectors;    /* [DGFEMI_STEP_VECTORS * unknowns] */
    dgfem_real *inverse;    /* of the diagonal blocks */
    int *piece;             /* [elements] the piece each belongs to: elements connected by glue */
    int piece_count;
    dgfem_real *gram;       /* [9 * pieces] A, restricted to translations of a piece */
    dgfem_vec3 *shift;      /* [pieces] such translations */
};

/* Work vectors: residual, P^-1 residual, direction, A direction; the residual turned back to A0, or a sweep's other
   half; 1 / (diagonal of A); directions of the start, and A times each. */
enum {
    DGFEMI_STEP_R,
    DGFEMI_STEP_Z,
    DGFEMI_STEP_P,
    DGFEMI_STEP_Q,
    DGFEMI_STEP_TURNED,
    DGFEMI_STEP_WEIGHT,
    DGFEMI_STEP_START,
    DGFEMI_STEP_START_PRODUCT = DGFEMI_STEP_START + 1 + DGFEM_PAST,
    DGFEMI_STEP_VECTORS = DGFEMI_STEP_START_PRODUCT + 1 + DGFEM_PAST
};

/* Dense kernels of a factorization are so much faster than the products of a sweep, and solves, which wait for memory,
   so much slower. */
#define DGFEM_FACTOR_SPEED 8.
#define DGFEM_SOLVE_SLOWNESS 1.5
/* What sweeps leave of the error is smooth, and adds up from step to step more than what a factorization leaves: they
   iterate to such a part of the tolerance. */
#define DGFEM_SWEEP_CARE 3.
/* A factorization that costs no more than so many iterations with sweeps is made at once. */
#define DGFEM_FEW_SWEEPS 12.
/* Averages of costs are over so many steps; the one that is not followed fades towards a guess in so many. */
#define DGFEM_COST_STEPS 16.
#define DGFEM_COST_FADING 100.

/* ---- creation ---- */

static void dgfemi_step_solver_destroy(dgfem_step_solver *solver, const dgfem_hooks *hooks) {
    if (!solver) return;
    dgfemi_free(hooks, solver->rotation);
    dgfemi_free(hooks, solver->turn);
    dgfemi_free(hooks, solver->touched);
    dgfemi_free(hooks, solver->in_patch);
    dgfemi_free(hooks, solver->patch);
    for (int k = 0; k < DGFEM_PAST; k++) dgfemi_free(hooks, solver->past[k]);
    dgfemi_free(hooks, solver->vectors);
    dgfemi_free(hooks, solver->inverse);
    dgfemi_free(hooks, solver->piece);
    dgfemi_free(hooks, solver->gram);
    dgfemi_free(hooks, solver->shift);
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
    solver->shift = (dgfem_vec3 *)dgfemi_allocate(hooks, (size_t)solver->piece_count, sizeof(dgfem_vec3));
    return solver->gram && solver->shift;
}

/* Numbers stored in the matrix. */
static double dgfemi_matrix_entries(const dgfem_matrix *matrix) {
    return (double)matrix->value_start[matrix->row_start[matrix->block_count]];
}

/* NULL when out of memory. */
static dgfem_step_solver *dgfemi_step_solver_create(const dgfem_mesh *mesh, const dgfem_matrix *matrix,
                                                    const dgfem_hooks *hooks) {
    dgfem_step_solver *solver = (dgfem_step_solver *)dgfemi_allocate_zero(hooks, 1, sizeof *solver);
    size_t elements = (size_t)matrix->block_count, size = (size_t)matrix->size;
    if (!solver) return NULL;
    solver->rotation = (dgfem_mat3 *)dgfemi_allocate(hooks, elements, sizeof(dgfem_mat3));
    solver->turn = (dgfem_mat3 *)dgfemi_allocate(hooks, elements, sizeof(dgfem_mat3));
    solver->touched = (char *)dgfemi_allocate_zero(hooks, elements, 1);
    solver->in_patch = (char *)dgfemi_allocate_zero(hooks, elements, 1);
    solver->patch = (int *)dgfemi_allocate(hooks, elements, sizeof(int));
    int past = 0;
    while (past < DGFEM_PAST && (solver->past[past] = (dgfem_real *)dgfemi_allocate(hooks, size, sizeof(dgfem_real))))
        past++;
    solver->vectors = (dgfem_real *)dgfemi_allocate(hooks, DGFEMI_STEP_VECTORS * size, sizeof(dgfem_real));
    solver->inverse = (dgfem_real *)dgfemi_allocate(hooks, dgfemi_diagonal_size(matrix), sizeof(dgfem_real));
    if (!solver->rotation || !solver->turn || !solver->touched || !solver->in_patch ||
        !solver->patch || past < DGFEM_PAST || !solver->vectors || !solver->inverse ||
        !dgfemi_step_solver_find_pieces(solver, mesh, hooks)) {
        dgfemi_step_solver_destroy(solver, hooks);
        return NULL;
    }
    solver->sweep_work = 5 * dgfemi_matrix_entries(matrix);
    return solver;
}

/* Two iterations a step, and a factorization in every thirty. */
static double dgfemi_guess_cost(const dgfem_step_solver *solver) {
    return 2 * solver->solve_work + solver->factor_work / 30;
}

/* Symbolic analysis of the body's matrix, if there is none. After a change of topology, when there may be another one
   soon, it is a quick one unless every step factors. */
static dgfem_status dgfemi_analyse_body(dgfem_body *body) {
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    if (body->cholesky) return DGFEM_OK;
    if (body->revision > 0 && body->step_solver) desc.ordering = DGFEM_ORDERING_QUICK;
    desc.hooks = body->hooks;
    desc.hooks.log = NULL; /* the creating functions leave the line for DGFEM_ERROR_MEMORY to their callers */
    dgfem_status status = dgfem_cholesky_create(body->matrix, &desc, &body->cholesky);
    if (status == DGFEM_ERROR_MEMORY) return status;
    if (status) return dgfemi_fail(&body->hooks, status, "Cholesky factor of %d elements", body->mesh->element_count);
    body->cholesky->hooks.log = body->hooks.log;
    if (!body->step_solver) return DGFEM_OK;
    body->step_solver->factor_work = body->cholesky->factor_flops / DGFEM_FACTOR_SPEED;
    body->step_solver->solve_work =
        4 * (DGFEM_SOLVE_SLOWNESS * body->cholesky->factor_entries + dgfemi_matrix_entries(body->matrix));
    if (body->step_solver->stale_cost == 0) body->step_solver->stale_cost = dgfemi_guess_cost(body->step_solver);
    return DGFEM_OK;
}

/* ---- the error of the velocities ---- */

/* The speed of a velocity field, as the root of its mean square over the mass. */
static double dgfemi_mean_speed(const dgfem_body *body, const dgfem_real *v) {
    return sqrt(dgfemi_mass_norm(body, (const dgfem_vec3 *)(const void *)v) / dgfemi_total_mass(body));
}

/* What a velocity's error is measured by: the mean speed, or a hundredth of an element's radius in a step if that is
   more. So a body comes to rest. */
static double dgfemi_reference_speed(const dgfem_body *body, dgfem_real h, const dgfem_real *v) {
    double radius = 0;
    for (int e = 0; e < body->mesh->element_count; e++) radius += (double)body->scale[e];
    double speed = dgfemi_mean_speed(body, v), least = 0.01 * radius / body->mesh->element_count / (double)h;
    return speed > least ? speed : least;
}

/* The last few iterations, of which the error that is left is estimated (Hestenes and Stiefel, Strakos and Tichy):
   in the norm of A, which is above that of the mass and here close to it, the error's square falls by step * rho in
   each iteration; what is still to come is as a geometric series, with the ratio at which a norm of the residual
   falls. */
enum { DGFEM_LOOK_BACK = 4 };
typedef struct dgfemi_progress {
    int count;
    double energy[DGFEM_LOOK_BACK];   /* step * rho of the last iterations, in a ring */
    double residual[DGFEM_LOOK_BACK]; /* at the beginning of each of them */
} dgfemi_progress;

/* After one more iteration; the error as a mean speed. */
static double dgfemi_estimate_error(dgfemi_progress *progress, double energy, double before, double after,
                                    double mass) {
    const double slowest = 0.97;
    int slot = progress->count++ % DGFEM_LOOK_BACK;
    progress->energy[slot] = energy;
    progress->residual[slot] = before;
    int known = progress->count < DGFEM_LOOK_BACK ? progress->count : DGFEM_LOOK_BACK;
    int oldest = (progress->count - known) % DGFEM_LOOK_BACK;
    double sum = 0, ratio = after / progress->residual[oldest], limit = pow(slowest, known);
    for (int i = 0; i < known; i++) sum += progress->energy[i];
    if (!(ratio < limit)) ratio = limit;
    return sqrt(sum / mass) * ratio / sqrt(1 - ratio * ratio);
}

/* ---- with a factorization ---- */

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

static dgfem_real *dgfemi_step_vector(const dgfem_body *body, int k) {
    return body->step_solver->vectors + (size_t)k * (size_t)body->matrix->size;
}

/* z += P^-1 r */
static void dgfemi_add_turned_solution(const dgfem_body *body, const dgfem_real *r, dgfem_real *z) {
    dgfem_real *turned = dgfemi_step_vector(body, DGFEMI_STEP_TURNED);
    dgfemi_turn_elements(body, 1, r, turned);
    dgfemi_solve(body->cholesky, 1, turned, turned);
    dgfemi_turn_elements(body, 0, turned, turned);
    dgfemi_vector_add(body->matrix->size, 1, turned, z);
}

/* The elements that contact makes or made stiffer than the turned factorization has them, and the inverses of their
   blocks. 0 when one is not positive definite. */
static int dgfemi_find_patch(const dgfem_body *body) {
    const dgfem_matrix *matrix = body->matrix;
    dgfem_step_solver *solver = body->step_solver;
    dgfem_real *inverse = solver->inverse;
    solver->patch_count = 0;
    for (int e = 0; e < matrix->block_count; e++) {
        int n = dgfemi_block_size(matrix, e);
        solver->in_patch[e] = solver->touched[e] || (body->shape_count && body->contacts->touched[e]);
        if (!solver->in_patch[e]) continue;
        solver->patch[solver->patch_count++] = e;
        if (!dgfemi_invert_diagonal_block(matrix, e, inverse)) return 0;
        inverse += n * n;
    }
    return 1;
}

/* z_e = D_e^-1 (r_e - sum of A_ec z_c over elements c < e of the patch), for the patch's e, ascending */
static void dgfemi_sweep_up(const dgfem_body *body, const dgfem_real *r, dgfem_real *z) {
    const dgfem_matrix *matrix = body->matrix;
    const dgfem_step_solver *solver = body->step_solver;
    const dgfem_real *inverse = solver->inverse;
    dgfem_real own[DGFEM_MAX_BLOCK];
    for (int i = 0; i < solver->patch_count; i++) {
        int e = solver->patch[i], n = dgfemi_block_size(matrix, e), first = matrix->offset[e];
        memset(own, 0, (size_t)n * sizeof *own);
        for (int k = matrix->row_start[e]; k < dgfemi_diagonal_index(matrix, e); k++) {
            int c = matrix->column[k];
            if (solver->in_patch[c])
                dgfemi_block_multiply(matrix->values + matrix->value_start[k], n, dgfemi_block_size(matrix, c),
                                      z + matrix->offset[c], own);
        }
        for (int j = 0; j < n; j++) own[j] = r[first + j] - own[j], z[first + j] = 0;
        dgfemi_block_multiply_transposed(inverse, n, n, own, z + first);
        inverse += n * n;
    }
}

/* z_e += D_e^-1 (r_e - sum of A_ec d_c over elements c > e of the patch), d_c what was added there, descending. r is
   used up. */
static void dgfemi_sweep_down(const dgfem_body *body, dgfem_real *r, dgfem_real *z) {
    const dgfem_matrix *matrix = body->matrix;
    const dgfem_step_solver *solver = body->step_solver;
    const dgfem_real *inverse = solver->inverse;
    dgfem_real added[DGFEM_MAX_BLOCK];
    for (int i = 0; i < solver->patch_count; i++) {
        int n = dgfemi_block_size(matrix, solver->patch[i]);
        inverse += n * n;
    }
    for (int i = solver->patch_count - 1; i >= 0; i--) {
        int e = solver->patch[i], n = dgfemi_block_size(matrix, e), first = matrix->offset[e];
        inverse -= n * n;
        memset(added, 0, (size_t)n * sizeof *added);
        dgfemi_block_multiply_transposed(inverse, n, n, r + first, added);
        for (int j = 0; j < n; j++) z[first + j] += added[j], added[j] = -added[j];
        for (int k = matrix->row_start[e]; k < dgfemi_diagonal_index(matrix, e); k++) {
            int c = matrix->column[k];
            if (solver->in_patch[c])
                dgfemi_block_multiply_transposed(matrix->values + matrix->value_start[k], n,
                                                 dgfemi_block_size(matrix, c), added, r + matrix->offset[c]);
        }
    }
}

static void dgfemi_apply_factor(void *context, const dgfem_real *r, dgfem_real *z) {
    const dgfem_body *body = (const dgfem_body *)context;
    dgfem_real *rest = dgfemi_step_vector(body, DGFEMI_STEP_Q);
    memset(z, 0, (size_t)body->matrix->size * sizeof *z);
    if (body->step_solver->patch_count == 0) {
        dgfemi_add_turned_solution(body, r, z);
        return;
    }
    dgfemi_sweep_up(body, r, z);
    dgfemi_residual(body->matrix, r, z, rest);
    dgfemi_add_turned_solution(body, rest, z);
    dgfemi_residual(body->matrix, r, z, rest);
    dgfemi_sweep_down(body, rest, z);
}

static void dgfemi_find_turns(const dgfem_body *body, const dgfem_mat3 *rotation) {
    dgfem_step_solver *solver = body->step_solver;
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfem_mat3 back = dgfemi_transposed(&solver->rotation[e]);
        solver->turn[e] = dgfemi_multiply3(&rotation[e], &back);
    }
}

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

/* Iterates until the error of x, as a mean speed, is below `target`, but at most `limit` times. Returns 1 when it is, 0
   at the limit or on breakdown. *error is the last estimate, infinite where there is none. */
static int dgfemi_iterate_with_factor(const dgfem_body *body, dgfemi_pcg *cg, double target, int limit, int *iterations,
                                      double *error) {
    int size = cg->matrix->size;
    dgfem_real *weight = dgfemi_step_vector(body, DGFEMI_STEP_WEIGHT);
    double mass = dgfemi_total_mass(body), last = 0;
    dgfemi_progress progress;
    progress.count = 0;
    dgfemi_weigh_by_diagonal(cg->matrix, weight);
    double residual = dgfemi_weighted_norm(size, weight, cg->r);
    *error = residual == 0 ? 0 : HUGE_VAL;
    if (residual == 0) return 1;
    for (int k = 0; k < limit; k++) {
        double before = residual;
        if (!dgfemi_pcg_turn(cg, last) || !dgfemi_pcg_advance(cg, cg->rho)) return 0;
        ++*iterations;
        residual = dgfemi_weighted_norm(size, weight, cg->r);
        *error = dgfemi_estimate_error(&progress, (double)cg->step * cg->rho, before, residual, mass);
        if (*error <= target) return 1;
        last = cg->rho;
    }
    return 0;
}

/* ---- with sweeps ---- */

/* The same with P of ssor.c. r is the residual of x before, and (D + L)^-1 times that after. */
static int dgfemi_iterate_with_sweeps(const dgfem_body *body, dgfemi_pcg *cg, double target, int limit, int *iterations,
                                      double *error) {
    int size = cg->matrix->size;
    dgfem_real *t = dgfemi_step_vector(body, DGFEMI_STEP_TURNED);
    double mass = dgfemi_total_mass(body), rho;
    dgfemi_progress progress;
    dgfemi_ssor sweeps;
    sweeps.matrix = cg->matrix;
    sweeps.kernels = dgfemi_product_kernels();
    sweeps.inverse = body->step_solver->inverse;
    progress.count = 0;
    *error = HUGE_VAL;
    if (dgfemi_invert_diagonal(cg->matrix, sweeps.inverse) != DGFEM_NONE) return 0;
    dgfemi_ssor_forward(&sweeps, cg->r);
    dgfemi_ssor_diagonal(&sweeps, cg->r, cg->z);
    rho = dgfemi_vector_dot(size, cg->r, cg->z);
    memcpy(cg->p, cg->z, (size_t)size * sizeof *cg->p);
    if (rho == 0) return *error = 0, 1;
    for (int k = 0; k < limit; k++) {
        double last = rho;
        dgfemi_ssor_backward(&sweeps, cg->p, t, cg->q);
        dgfemi_ssor_forward(&sweeps, cg->q);
        dgfemi_vector_add(size, 1, t, cg->q);
        double curvature = dgfemi_vector_dot(size, cg->p, cg->q), step = rho / curvature;
        if (!(curvature > 0) || !(step > 0) || !(step - step == 0)) return 0;
        ++*iterations;
        dgfemi_vector_add(size, (dgfem_real)step, t, cg->x);
        dgfemi_vector_add(size, (dgfem_real)-step, cg->q, cg->r);
        dgfemi_ssor_diagonal(&sweeps, cg->r, cg->z);
        rho = dgfemi_vector_dot(size, cg->r, cg->z);
        *error = dgfemi_estimate_error(&progress, step * last, sqrt(last), sqrt(rho), mass);
        if (*error <= target) return 1;
        dgfemi_vector_scale_add(size, cg->z, (dgfem_real)(rho / last), cg->p);
    }
    return 0;
}

/* ---- pieces ---- */

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

/* The translation of each piece that takes the resultant from the residual r. */
static void dgfemi_find_shifts(const dgfem_body *body, const dgfem_real *r) {
    dgfem_step_solver *solver = body->step_solver;
    const dgfem_vec3 *force = (const dgfem_vec3 *)(const void *)r;
    dgfemi_gather_gram(body);
    memset(solver->shift, 0, (size_t)solver->piece_count * sizeof *solver->shift);
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfem_vec3 *sum = &solver->shift[solver->piece[e]];
        *sum = dgfemi_add(*sum, force[body->basis_start[e]]);
    }
    for (int k = 0; k < solver->piece_count; k++) {
        dgfem_real *shift = (dgfem_real *)(void *)&solver->shift[k], *gram = solver->gram + 9 * (size_t)k;
        if (dgfemi_cholesky_dense(gram, 3)) dgfemi_cholesky_dense_solve(gram, 3, shift, 1);
        else memset(shift, 0, 3 * sizeof *shift);
    }
}

/* Moves each piece as a whole so that the residual r of x would have no resultant. */
static void dgfemi_balance_pieces(const dgfem_body *body, const dgfem_real *r, dgfem_real *x) {
    const dgfem_step_solver *solver = body->step_solver;
    dgfem_vec3 *to = (dgfem_vec3 *)(void *)x;
    dgfemi_find_shifts(body, r);
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfem_vec3 *v = &to[body->basis_start[e]];
        *v = dgfemi_add(*v, solver->shift[solver->piece[e]]);
    }
}

/* ---- the whole ---- */

/* Factors the matrix, or logs why not. */
static dgfem_status dgfemi_factor_step(dgfem_body *body, const dgfem_mat3 *rotation, dgfem_step_info *info) {
    dgfem_step_solver *solver = body->step_solver;
    double start = dgfemi_clock(&body->hooks);
    dgfem_cholesky_info factor;
    solver->is_factored = 0;
    dgfem_status status = dgfemi_analyse_body(body);
    if (status) return status == DGFEM_ERROR_MEMORY ? dgfemi_fail_memory(&body->hooks) : status;
    status = dgfem_cholesky_factor(body->cholesky, body->matrix, &factor);
    info->seconds_factor += dgfemi_clock(&body->hooks) - start;
    info->failed_element = factor.failed_block;
    info->factorizations++;
    if (status) return status;
    memcpy(solver->rotation, rotation, (size_t)body->mesh->element_count * sizeof *rotation);
    for (int e = 0; e < body->mesh->element_count; e++)
        solver->touched[e] = body->shape_count && body->contacts->touched[e];
    solver->is_factored = 1;
    solver->rent = 0;
    return DGFEM_OK;
}

/* Moves x along the part of direction number `count` that is conjugate to those before it, so far as lowers the error's
   energy most. 0 where there is no such part. */
static int dgfemi_move_start(const dgfem_body *body, dgfemi_pcg *cg, int count, double curvature[]) {
    int size = cg->matrix->size;
    dgfem_real *p = dgfemi_step_vector(body, DGFEMI_STEP_START + count);
    dgfem_real *q = dgfemi_step_vector(body, DGFEMI_STEP_START_PRODUCT + count);
    dgfem_matrix_multiply(cg->matrix, p, q);
    double whole = dgfemi_vector_dot(size, p, q);
    for (int k = 0; k < count; k++) {
        const dgfem_real *earlier = dgfemi_step_vector(body, DGFEMI_STEP_START_PRODUCT + k);
        dgfem_real part = (dgfem_real)(-dgfemi_vector_dot(size, p, earlier) / curvature[k]);
        dgfemi_vector_add(size, part, dgfemi_step_vector(body, DGFEMI_STEP_START + k), p);
        dgfemi_vector_add(size, part, earlier, q);
    }
    curvature[count] = dgfemi_vector_dot(size, p, q);
    /* also where A is not positive definite */
    if (!(curvature[count] > (double)dgfemi_sqrt(DGFEM_EPSILON) * fabs(whole))) return 0;
    dgfem_real step = (dgfem_real)(dgfemi_vector_dot(size, p, cg->r) / curvature[count]);
    if (!dgfemi_is_finite(step)) return 0;
    dgfemi_vector_add(size, step, p, cg->x);
    dgfemi_vector_add(size, -step, q, cg->r);
    return 1;
}

/* x = the velocities now, moved along their last changes; before there are any, moved with each piece as a whole. */
static void dgfemi_start_step(const dgfem_body *body, dgfemi_pcg *cg) {
    const dgfem_step_solver *solver = body->step_solver;
    size_t bytes = (size_t)cg->matrix->size * sizeof *cg->x;
    double curvature[1 + DGFEM_PAST];
    dgfem_real *p = dgfemi_step_vector(body, DGFEMI_STEP_START);
    memcpy(cg->x, body->velocity, bytes);
    dgfemi_pcg_residual(cg);
    memcpy(p, body->change, bytes);
    if (dgfemi_vector_is_zero(cg->matrix->size, p)) dgfemi_balance_pieces(body, cg->r, p);
    int count = dgfemi_move_start(body, cg, 0, curvature);
    for (int k = 0; k < solver->past_count; k++) {
        memcpy(dgfemi_step_vector(body, DGFEMI_STEP_START + count), solver->past[k], bytes);
        count += dgfemi_move_start(body, cg, count, curvature);
    }
}

/* After a step that went well, when the body has yet the change of the step before. */
static void dgfemi_remember_change(const dgfem_body *body) {
    dgfem_step_solver *solver = body->step_solver;
    dgfem_real *oldest = solver->past[DGFEM_PAST - 1];
    for (int k = DGFEM_PAST - 1; k > 0; k--) solver->past[k] = solver->past[k - 1];
    solver->past[0] = oldest;
    memcpy(oldest, body->change, (size_t)body->matrix->size * sizeof *oldest);
    if (solver->past_count < DGFEM_PAST) solver->past_count++;
}

/* Iterations that the rest of a price pays. */
static int dgfemi_affordable(double price, double rent, double work) {
    double count = (price - rent) / work;
    return count < 1 ? 0 : count < 1e6 ? (int)count : 1000000;
}

/* Iterates with the factorization, if there is one and its rent is not up; or else gives it up. 1 when x is good
   enough. */
static int dgfemi_iterate_stale(dgfem_body *body, dgfemi_pcg *cg, const dgfem_mat3 *rotation, double target,
                                int *iterations, double *error) {
    dgfem_step_solver *solver = body->step_solver;
    int before = *iterations, good = 0;
    int limit = dgfemi_affordable(solver->factor_work, solver->rent, solver->solve_work);
    if (!solver->is_factored) return 0;
    if (solver->rent < solver->factor_work) {
        dgfemi_find_turns(body, rotation);
        good = dgfemi_find_patch(body) &&
               dgfemi_iterate_with_factor(body, cg, target, limit + 1, iterations, error);
        double work = (*iterations - before) * solver->solve_work;
        if (work > solver->solve_work) solver->rent += work - solver->solve_work; /* rest is no credit */
        solver->stale_cost += (work - solver->stale_cost) / DGFEM_COST_STEPS;
    }
    solver->is_factored = good;
    return good;
}

/* The same with sweeps, which may cost as much as a factorization. cg->r is not the residual after them. */
static int dgfemi_iterate_sweeping(dgfem_body *body, dgfemi_pcg *cg, double target, int *iterations, double *error) {
    dgfem_step_solver *solver = body->step_solver;
    int before = *iterations, limit = dgfemi_affordable(solver->factor_work, 0, solver->sweep_work);
    int good = dgfemi_iterate_with_sweeps(body, cg, target / DGFEM_SWEEP_CARE, limit, iterations, error);
    double work = (*iterations - before) * solver->sweep_work;
    if (solver->sweeps_cost == 0) solver->sweeps_cost = work;
    solver->sweeps_cost = good ? solver->sweeps_cost + (work - solver->sweeps_cost) / DGFEM_COST_STEPS : 2 * work;
    solver->rent += work;
    return good;
}

/* Iterates with what there is, as the body's solver and the price of a factorization allow. 1 when x is good enough. */
static int dgfemi_iterate_step(dgfem_body *body, dgfemi_pcg *cg, const dgfem_mat3 *rotation, double target,
                               int *iterations, double *error) {
    dgfem_step_solver *solver = body->step_solver;
    if (body->desc.solver == DGFEM_SOLVER_SWEEPS)
        return dgfemi_iterate_with_sweeps(body, cg, target / DGFEM_SWEEP_CARE, body->desc.solver_iterations, iterations,
                                          error);
    if (body->desc.solver == DGFEM_SOLVER_STALE)
        return dgfemi_iterate_stale(body, cg, rotation, target, iterations, error);
    int affordable = dgfemi_affordable(solver->factor_work, 0, solver->sweep_work) >= DGFEM_FEW_SWEEPS;
    if (affordable && solver->sweeps_cost < solver->stale_cost) {
        solver->stale_cost += (dgfemi_guess_cost(solver) - solver->stale_cost) / DGFEM_COST_FADING;
        return dgfemi_iterate_sweeping(body, cg, target, iterations, error);
    }
    solver->sweeps_cost *= 1 - 1 / DGFEM_COST_FADING;
    if (dgfemi_iterate_stale(body, cg, rotation, target, iterations, error)) return 1;
    return affordable && solver->sweeps_cost < solver->factor_work && solver->rent < solver->factor_work &&
           dgfemi_iterate_sweeping(body, cg, target, iterations, error);
}

/* The failure of sweeps, which have no factorization to fall back on. */
static dgfem_status dgfemi_fail_sweeps(const dgfem_body *body, double error, dgfem_step_info *info) {
    info->failed_element = dgfemi_invert_diagonal(body->matrix, body->step_solver->inverse);
    if (info->failed_element != DGFEM_NONE)
        return dgfemi_fail(&body->hooks, DGFEM_ERROR_NOT_POSITIVE_DEFINITE, "step: diagonal block of element %d",
                           info->failed_element);
    return dgfemi_fail(&body->hooks, DGFEM_ERROR_NOT_CONVERGED,
                       "step: velocities off by %g of their mean after %d iterations", error, info->iterations);
}

/* Solves matrix * v = rhs for the velocities at the end of a step of length h. `rotation` are the elements' rotations
   that the matrix was assembled with. */
static dgfem_status dgfemi_solve_step(dgfem_body *body, dgfem_real h, const dgfem_mat3 *rotation, const dgfem_real *rhs,
                                      dgfem_real *v, dgfem_step_info *info) {
    double factor_before = info->seconds_factor, start = dgfemi_clock(&body->hooks), error = 0;
    double reference = dgfemi_reference_speed(body, h, (const dgfem_real *)(const void *)body->velocity);
    double target = (double)body->desc.velocity_tolerance * reference;
    dgfem_status status = DGFEM_OK;
    dgfemi_pcg cg;
    memset(&cg, 0, sizeof cg);
    cg.matrix = body->matrix, cg.b = rhs, cg.x = v;
    cg.preconditioner.apply = dgfemi_apply_factor;
    cg.preconditioner.context = body;
    cg.r = dgfemi_step_vector(body, DGFEMI_STEP_R), cg.z = dgfemi_step_vector(body, DGFEMI_STEP_Z);
    cg.p = dgfemi_step_vector(body, DGFEMI_STEP_P), cg.q = dgfemi_step_vector(body, DGFEMI_STEP_Q);
    dgfemi_start_step(body, &cg);
    if (!dgfemi_iterate_step(body, &cg, rotation, target, &info->iterations, &error)) {
        if (body->desc.solver == DGFEM_SOLVER_SWEEPS) return dgfemi_fail_sweeps(body, error / reference, info);
        status = dgfemi_factor_step(body, rotation, info);
        if (status) return status;
        body->step_solver->stale_cost += body->step_solver->factor_work / DGFEM_COST_STEPS;
        dgfemi_find_turns(body, rotation);
        body->step_solver->patch_count = 0; /* the factorization is of this very matrix */
        dgfemi_pcg_residual(&cg);
        (void)dgfemi_iterate_with_factor(body, &cg, target, 1, &info->iterations, &error);
    }
    info->residual = (dgfem_real)(error / reference);
    dgfemi_pcg_residual(&cg);
    dgfemi_balance_pieces(body, cg.r, cg.x);
    info->seconds_solve += dgfemi_clock(&body->hooks) - start - (info->seconds_factor - factor_before);
    return status;
}
