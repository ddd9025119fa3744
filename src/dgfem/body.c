#pragma once
#include "contact.c"
#include "step_solver.c"
#include "warp.c"
/* State of a solid: descriptors, creation, the block system and its solver. */

DGFEM_API dgfem_body_desc dgfem_default_body_desc(void) {
    dgfem_body_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.material.young = DGFEM_R(1e6);
    desc.material.poisson = DGFEM_R(0.3);
    desc.material.density = 1000;
    desc.degree = 1;
    desc.flux = DGFEM_FLUX_IP;
    desc.penalty = DGFEM_PENALTY_SPLIT;
    desc.eta = 4;
    desc.eta_rest = DGFEM_R(0.5);
    desc.gravity.z = DGFEM_R(-9.81);
    desc.warp = 1;
    desc.solver = DGFEM_SOLVER_AUTO;
    desc.velocity_tolerance = DGFEM_R(1e-3);
    desc.solver_tolerance = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-6);
    desc.solver_iterations = 1000;
    return desc;
}

DGFEM_API dgfem_static_desc dgfem_default_static_desc(void) {
    dgfem_static_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.load_steps = 1;
    desc.max_sweeps = 60;
    desc.tolerance = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-9);
    return desc;
}

DGFEM_API dgfem_shape_desc dgfem_default_shape_desc(void) {
    dgfem_shape_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.plane.normal.z = 1;
    desc.radius = 1;
    desc.stiffness = 10;
    desc.damping = DGFEM_R(0.005);
    desc.friction = DGFEM_R(0.5);
    desc.slip_speed = DGFEM_R(1e-3);
    return desc;
}

/* ---- creation ---- */

static dgfem_status dgfemi_check_material(const dgfem_hooks *hooks, const dgfem_material *m, int element) {
    if (!(m->young > 0) || !dgfemi_is_finite(m->young))
        return dgfemi_fail(hooks, DGFEM_ERROR_MATERIAL, "element %d: Young's modulus %g, expected > 0", element,
                           (double)m->young);
    if (!(m->poisson > -1 && m->poisson < DGFEM_R(0.5)))
        return dgfemi_fail(hooks, DGFEM_ERROR_MATERIAL, "element %d: Poisson's ratio %g, expected in (-1, 0.5)",
                           element, (double)m->poisson);
    if (!(m->density > 0) || !dgfemi_is_finite(m->density))
        return dgfemi_fail(hooks, DGFEM_ERROR_MATERIAL, "element %d: density %g, expected > 0", element,
                           (double)m->density);
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_not_negative(const dgfem_hooks *hooks, dgfem_real value, const char *what) {
    if (value >= 0 && dgfemi_is_finite(value)) return DGFEM_OK;
    return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s is %g, expected >= 0", what, (double)value);
}

static dgfem_status dgfemi_check_positive(const dgfem_hooks *hooks, dgfem_real value, const char *what) {
    if (value > 0 && dgfemi_is_finite(value)) return DGFEM_OK;
    return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s is %g, expected > 0", what, (double)value);
}

/* A descriptor given to a living body, whose log can be trusted. */
static dgfem_status dgfemi_check_desc(const dgfem_hooks *hooks, const void *desc, unsigned cookie, const char *what) {
    dgfem_status status = dgfemi_check_cookie(desc, cookie);
    return status ? dgfemi_fail(hooks, status, "%s", what) : DGFEM_OK;
}

static dgfem_status dgfemi_check_out(const dgfem_hooks *hooks, const void *out, const char *what) {
    return out ? DGFEM_OK : dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: out is NULL", what);
}

static dgfem_status dgfemi_check_body_scalars(const dgfem_body_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    dgfem_status status = dgfemi_check_positive(hooks, desc->eta, "eta");
    if (!status) status = dgfemi_check_not_negative(hooks, desc->eta_rest, "eta_rest");
    if (!status) status = dgfemi_check_not_negative(hooks, desc->damping_mass, "damping_mass");
    if (!status) status = dgfemi_check_not_negative(hooks, desc->damping_stiffness, "damping_stiffness");
    if (!status) status = dgfemi_check_positive(hooks, desc->solver_tolerance, "solver_tolerance");
    if (!status) status = dgfemi_check_positive(hooks, desc->velocity_tolerance, "velocity_tolerance");
    if (!status && !dgfemi_is_finite3(desc->gravity))
        status = dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "gravity (%g, %g, %g)", (double)desc->gravity.x,
                             (double)desc->gravity.y, (double)desc->gravity.z);
    if (!status && desc->solver_iterations < 1)
        status =
            dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "solver_iterations is %d, expected >= 1", desc->solver_iterations);
    if (!status && (desc->flux != DGFEM_FLUX_IP && desc->flux != DGFEM_FLUX_BZ))
        status = dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "unknown flux %d", (int)desc->flux);
    if (!status && ((int)desc->penalty < 0 || desc->penalty > DGFEM_PENALTY_SCALAR))
        status = dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "unknown penalty %d", (int)desc->penalty);
    if (!status && ((int)desc->solver < 0 || desc->solver > DGFEM_SOLVER_PCG))
        status = dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "unknown solver %d", (int)desc->solver);
    return status;
}

static dgfem_status dgfemi_check_body_desc(const dgfem_body_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    if (!desc->mesh) return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "body: no mesh");
    if (desc->mesh->element_count < 1) return dgfemi_fail(hooks, DGFEM_ERROR_EMPTY, "body: the mesh has no elements");
    dgfem_status status = dgfemi_check_body_scalars(desc);
    for (int e = 0; !status && e < desc->mesh->element_count; e++) {
        int degree = desc->degrees ? desc->degrees[e] : desc->degree;
        status = dgfemi_check_material(hooks, desc->materials ? &desc->materials[e] : &desc->material, e);
        if (!status && (degree < 1 || degree > DGFEM_MAX_DEGREE))
            status = dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "element %d: degree %d, expected 1..%d", e, degree,
                                 DGFEM_MAX_DEGREE);
        if (!status && !(desc->mesh->elements[e].volume > 0 && desc->mesh->elements[e].radius > 0))
            status = dgfemi_fail(hooks, DGFEM_ERROR_DEGENERATE, "element %d has the volume %g", e,
                                 (double)desc->mesh->elements[e].volume);
    }
    return status;
}

/* The arrays that have one entry per element or per basis function. 0 when out of memory. */
static int dgfemi_body_allocate(dgfem_body *body, int elements) {
    const dgfem_hooks *hooks = &body->hooks;
    size_t n = (size_t)elements;
    body->degree = (int *)dgfemi_allocate(hooks, n, sizeof(int));
    body->material = (dgfem_material *)dgfemi_allocate(hooks, n, sizeof(dgfem_material));
    body->origin = (dgfem_vec3 *)dgfemi_allocate(hooks, n, sizeof(dgfem_vec3));
    body->scale = (dgfem_real *)dgfemi_allocate(hooks, n, sizeof(dgfem_real));
    body->rotation = (dgfem_mat3 *)dgfemi_allocate(hooks, 2 * n, sizeof(dgfem_mat3));
    body->basis_start = (int *)dgfemi_allocate(hooks, n + 1, sizeof(int));
    return body->degree && body->material && body->origin && body->scale && body->rotation && body->basis_start;
}

static int dgfemi_body_allocate_state(dgfem_body *body) {
    const dgfem_hooks *hooks = &body->hooks;
    size_t n = (size_t)body->basis_count;
    body->displacement = (dgfem_vec3 *)dgfemi_allocate_zero(hooks, n, sizeof(dgfem_vec3));
    body->velocity = (dgfem_vec3 *)dgfemi_allocate_zero(hooks, n, sizeof(dgfem_vec3));
    body->change = (dgfem_vec3 *)dgfemi_allocate_zero(hooks, n, sizeof(dgfem_vec3));
    body->force = (dgfem_vec3 *)dgfemi_allocate_zero(hooks, n, sizeof(dgfem_vec3));
    return body->displacement && body->velocity && body->change && body->force;
}

static void dgfemi_body_set_elements(dgfem_body *body, const dgfem_body_desc *desc) {
    for (int e = 0; e < desc->mesh->element_count; e++) {
        body->degree[e] = desc->degrees ? desc->degrees[e] : desc->degree;
        body->material[e] = desc->materials ? desc->materials[e] : desc->material;
        body->origin[e] = desc->mesh->elements[e].centre;
        body->scale[e] = desc->mesh->elements[e].radius;
        body->rotation[e] = dgfemi_identity();
    }
}

/* basis_start and basis_count from the degrees. The unknowns, three per function, are counted in int. */
static dgfem_status dgfemi_body_count_basis(dgfem_body *body) {
    int start = 0;
    for (int e = 0; e < body->mesh->element_count; e++) {
        int count = dgfem_monomial_count(body->degree[e]);
        if (start > INT_MAX / 3 - count)
            return dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "element %d makes more than INT_MAX unknowns", e);
        body->basis_start[e] = start;
        start += count;
    }
    body->basis_start[body->mesh->element_count] = start;
    body->basis_count = start;
    return DGFEM_OK;
}

/* The block matrix of the element graph: elements coupled through glued faces. Like all that the creating functions
   call here, it leaves the log line for DGFEM_ERROR_MEMORY to them, so that there is one. */
static dgfem_status dgfemi_body_create_matrix(dgfem_body *body) {
    const dgfem_mesh *mesh = body->mesh;
    dgfemi_arena arena = dgfemi_arena_make(&body->hooks);
    dgfem_matrix_desc desc = dgfem_default_matrix_desc();
    int *sizes = (int *)dgfemi_arena_allocate(&arena, (size_t)mesh->element_count, sizeof(int));
    int *pairs = (int *)dgfemi_arena_allocate(&arena, 2 * (size_t)mesh->face_count, sizeof(int));
    dgfem_status status = DGFEM_ERROR_MEMORY;
    if (sizes && pairs) {
        for (int e = 0; e < mesh->element_count; e++) sizes[e] = 3 * dgfem_monomial_count(body->degree[e]);
        for (int f = 0; f < mesh->face_count; f++) {
            const dgfem_face *face = &mesh->faces[f];
            if (face->element[1] == DGFEM_NONE || face->cut) continue;
            pairs[2 * (size_t)desc.pair_count] = face->element[0];
            pairs[2 * (size_t)desc.pair_count + 1] = face->element[1];
            desc.pair_count++;
        }
        desc.block_count = mesh->element_count;
        desc.block_sizes = sizes;
        desc.pairs = pairs;
        desc.centres = body->origin;
        desc.hooks = body->hooks;
        desc.hooks.log = NULL;
        status = dgfem_matrix_create(&desc, &body->matrix);
        if (!status) body->matrix->hooks.log = body->hooks.log;
    }
    dgfemi_arena_free(&arena);
    if (status && status != DGFEM_ERROR_MEMORY)
        return dgfemi_fail(&body->hooks, status, "matrix of %d elements and %d faces", mesh->element_count,
                           mesh->face_count);
    return status;
}

/* Work vectors of a step, in units of basis_count vectors; PCG's own work follows. */
enum { DGFEMI_WORK_F0, DGFEMI_WORK_RHS, DGFEMI_WORK_X, DGFEMI_WORK_Y, DGFEMI_WORK_COUNT };

static dgfem_vec3 *dgfemi_work(const dgfem_body *body, int k) {
    return (dgfem_vec3 *)(void *)body->work + (size_t)k * (size_t)body->basis_count;
}

/* What a solver of the body's matrix needs. After a change of topology the automatic choice may do without an analysis
   of the matrix, and makes it when it is needed. */
static dgfem_status dgfemi_body_create_factor(dgfem_body *body, const dgfem_step_solver *former) {
    dgfem_solver solver = body->desc.solver;
    size_t vectors = DGFEMI_WORK_COUNT * 3 * (size_t)body->basis_count;
    dgfem_status status = DGFEM_OK;
    if (solver == DGFEM_SOLVER_PCG || solver == DGFEM_SOLVER_SWEEPS) vectors += dgfem_pcg_work_size(body->matrix);
    body->work = (dgfem_real *)dgfemi_allocate(&body->hooks, vectors, sizeof(dgfem_real));
    if (!body->work) return DGFEM_ERROR_MEMORY;
    if (solver == DGFEM_SOLVER_AUTO || solver == DGFEM_SOLVER_STALE || solver == DGFEM_SOLVER_SWEEPS) {
        body->step_solver = dgfemi_step_solver_create(body->mesh, body->matrix, &body->hooks);
        if (!body->step_solver) return DGFEM_ERROR_MEMORY;
    }
    if (solver == DGFEM_SOLVER_AUTO && former) {
        body->step_solver->factor_work = former->factor_work;
        body->step_solver->solve_work = former->solve_work;
        body->step_solver->stale_cost = former->stale_cost;
        body->step_solver->sweeps_cost = former->sweeps_cost;
    } else if (solver != DGFEM_SOLVER_PCG && solver != DGFEM_SOLVER_SWEEPS) {
        status = dgfemi_analyse_body(body);
    }
    return status;
}

static dgfem_status dgfemi_body_create_solver(dgfem_body *body) {
    dgfem_status status = dgfemi_body_create_matrix(body);
    return status ? status : dgfemi_body_create_factor(body, NULL);
}

static dgfem_status dgfemi_body_build(dgfem_body *body, const dgfem_body_desc *desc) {
    if (!dgfemi_body_allocate(body, desc->mesh->element_count)) return DGFEM_ERROR_MEMORY;
    dgfemi_body_set_elements(body, desc);
    dgfem_status status = dgfemi_body_count_basis(body);
    if (status) return status;
    if (!dgfemi_body_allocate_state(body)) return DGFEM_ERROR_MEMORY;
    body->forms = dgfemi_forms_create(body);
    if (!body->forms) return DGFEM_ERROR_MEMORY;
    return dgfemi_body_create_solver(body);
}

static void dgfemi_condition_free(const dgfem_hooks *hooks, dgfem_condition *condition) {
    dgfemi_free(hooks, condition->items);
    dgfemi_free(hooks, condition->values);
}

/* Frees everything but the mesh. */
static void dgfemi_body_free(dgfem_body *body) {
    dgfem_hooks hooks = body->hooks;
    for (int i = 0; i < body->condition_count; i++) dgfemi_condition_free(&hooks, &body->conditions[i]);
    dgfemi_free(&hooks, body->conditions);
    dgfemi_free(&hooks, body->shapes);
    dgfemi_free(&hooks, body->degree);
    dgfemi_free(&hooks, body->material);
    dgfemi_free(&hooks, body->origin);
    dgfemi_free(&hooks, body->scale);
    dgfemi_free(&hooks, body->rotation);
    dgfemi_free(&hooks, body->basis_start);
    dgfemi_free(&hooks, body->displacement);
    dgfemi_free(&hooks, body->velocity);
    dgfemi_free(&hooks, body->change);
    dgfemi_free(&hooks, body->force);
    dgfemi_free(&hooks, body->family);
    dgfemi_free(&hooks, body->family_parent);
    dgfemi_free(&hooks, body->work);
    dgfemi_forms_destroy(body->forms, &hooks);
    dgfemi_contacts_destroy(body->contacts);
    dgfem_matrix_destroy(body->matrix);
    dgfem_cholesky_destroy(body->cholesky);
    dgfemi_step_solver_destroy(body->step_solver, &hooks);
    dgfemi_free(&hooks, body);
}

DGFEM_API dgfem_status dgfem_body_create(const dgfem_body_desc *desc, dgfem_body **out) {
    if (out) *out = NULL;
    dgfem_status status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (status) return status;
    if (!out) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "body: out is NULL");
    status = dgfemi_check_body_desc(desc);
    if (status) return status;
    dgfem_body *body = (dgfem_body *)dgfemi_allocate_zero(&desc->hooks, 1, sizeof *body);
    if (!body) return dgfemi_fail_memory(&desc->hooks);
    body->desc = *desc;
    body->desc.materials = NULL; /* the caller's arrays need not outlive this call */
    body->desc.degrees = NULL;
    body->hooks = desc->hooks;
    body->mesh = desc->mesh;
    status = dgfemi_body_build(body, desc);
    if (status) {
        dgfemi_body_free(body);
        return status == DGFEM_ERROR_MEMORY ? dgfemi_fail_memory(&desc->hooks) : status;
    }
    *out = body;
    return DGFEM_OK;
}

DGFEM_API void dgfem_body_destroy(dgfem_body *body) {
    if (!body) return;
    dgfem_mesh_destroy(body->mesh);
    dgfemi_body_free(body);
}

/* ---- fields ---- */

static dgfem_vec3 dgfemi_evaluate(const dgfem_body *body, const dgfem_vec3 *coefficients, int element, dgfem_vec3 x) {
    dgfem_real n[DGFEM_MAX_BASIS];
    dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
    int start = body->basis_start[element];
    dgfemi_basis_evaluate(body->degree[element], body->origin[element], body->scale[element], x, n);
    for (int i = 0; i < body->basis_start[element + 1] - start; i++)
        sum = dgfemi_add_scaled(sum, n[i], coefficients[start + i]);
    return sum;
}

/* Coefficients of value(x) = translation + linear x in one element. */
static void dgfemi_affine_element(const dgfem_body *body, int element, const dgfem_mat3 *linear, dgfem_vec3 translation,
                                  dgfem_vec3 *coefficients) {
    memset(coefficients, 0, (size_t)dgfem_monomial_count(body->degree[element]) * sizeof *coefficients);
    coefficients[0] = dgfemi_add(translation, dgfemi_multiply(linear, body->origin[element]));
    for (int j = 0; j < 3; j++) coefficients[1 + j] = dgfemi_scale(body->scale[element], dgfemi_column(linear, j));
}

static dgfem_status dgfemi_check_affine(const dgfem_body *body, const dgfem_mat3 *linear, dgfem_vec3 translation) {
    if (dgfemi_is_finite_mat3(linear) && dgfemi_is_finite3(translation)) return DGFEM_OK;
    return dgfemi_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "affine field");
}
