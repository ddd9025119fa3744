#pragma once
#include "system.c"
/* A body's beginning and end. */

DGFEM_API dgfem_mvc_desc dgfem_default_mvc_desc(void) {
    dgfem_mvc_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_MVC_COOKIE;
    desc.material.young = DGFEM_R(1e6);
    desc.material.poisson = DGFEM_R(0.3);
    desc.material.density = 1000;
    desc.quadrature = DGFEM_MVC_TET4;
    desc.gravity = dgfem_mvci_vec3(0, 0, DGFEM_R(-9.81));
    desc.warp = 1;
    desc.solver = DGFEM_SOLVER_CHOLESKY;
    desc.solver_tolerance = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-6);
    desc.solver_iterations = 1000;
    return desc;
}

/* A finite number, at least 0 (positive: above 0). */
static dgfem_status dgfem_mvci_check_scalar(const dgfem_hooks *hooks, dgfem_real x, int positive, const char *what) {
    if (!dgfem_mvci_is_finite(x)) return dgfem_mvci_fail(hooks, DGFEM_ERROR_NOT_FINITE, "%s %g", what, (double)x);
    if (positive ? x > 0 : x >= 0) return DGFEM_OK;
    return dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s %g, expected %s 0", what, (double)x, positive ? ">" : ">=");
}

static dgfem_status dgfem_mvci_check_vector(const dgfem_hooks *hooks, dgfem_vec3 v, const char *what) {
    if (dgfem_mvci_is_finite3(v)) return DGFEM_OK;
    return dgfem_mvci_fail(hooks, DGFEM_ERROR_NOT_FINITE, "%s (%g, %g, %g)", what, (double)v.x, (double)v.y,
                           (double)v.z);
}

static dgfem_status dgfem_mvci_check_material(const dgfem_hooks *hooks, const dgfem_material *m, int element) {
    if (m->young > 0 && dgfem_mvci_is_finite(m->young) && m->density > 0 && dgfem_mvci_is_finite(m->density) &&
        m->poisson > -1 && m->poisson < DGFEM_R(0.5))
        return DGFEM_OK;
    return dgfem_mvci_fail(hooks, DGFEM_ERROR_MATERIAL, "element %d: young %g, poisson %g, density %g", element,
                           (double)m->young, (double)m->poisson, (double)m->density);
}

static dgfem_status dgfem_mvci_check_desc(const dgfem_mvc_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    if (!desc->mesh) return dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "no mesh");
    if (desc->mesh->element_count < 1) return dgfem_mvci_fail(hooks, DGFEM_ERROR_EMPTY, "the mesh has no element");
    if ((int)desc->quadrature < 0 || desc->quadrature > DGFEM_MVC_PAPER_RAW)
        return dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "unknown quadrature %d", (int)desc->quadrature);
    if (desc->solver != DGFEM_SOLVER_CHOLESKY && desc->solver != DGFEM_SOLVER_PCG)
        return dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT,
                               "solver %d: only DGFEM_SOLVER_CHOLESKY (%d) and DGFEM_SOLVER_PCG (%d) serve here",
                               (int)desc->solver, (int)DGFEM_SOLVER_CHOLESKY, (int)DGFEM_SOLVER_PCG);
    if (desc->solver_iterations < 1)
        return dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "%d solver_iterations", desc->solver_iterations);
    dgfem_status status = dgfem_mvci_check_scalar(hooks, desc->stabilisation, 0, "stabilisation");
    if (!status) status = dgfem_mvci_check_scalar(hooks, desc->damping_mass, 0, "damping_mass");
    if (!status) status = dgfem_mvci_check_scalar(hooks, desc->damping_stiffness, 0, "damping_stiffness");
    if (!status) status = dgfem_mvci_check_scalar(hooks, desc->solver_tolerance, 1, "solver_tolerance");
    if (!status) status = dgfem_mvci_check_vector(hooks, desc->gravity, "gravity");
    for (int e = 0; !status && e < desc->mesh->element_count; e++)
        status = dgfem_mvci_check_material(hooks, desc->materials ? &desc->materials[e] : &desc->material, e);
    return status;
}

static void dgfem_mvci_free_conditions(const dgfem_hooks *hooks, dgfem_mvc_condition *conditions, int count) {
    for (int c = 0; c < count; c++) {
        dgfem_mvci_free(hooks, conditions[c].items);
        dgfem_mvci_free(hooks, conditions[c].share);
    }
    dgfem_mvci_free(hooks, conditions);
}

DGFEM_API void dgfem_mvc_destroy(dgfem_mvc *body) {
    if (!body) return;
    dgfem_hooks hooks = body->hooks;
    dgfem_mvci_free_topology(body);
    dgfem_mvci_mesh_destroy(body->mesh);
    dgfem_mvci_free_conditions(&hooks, body->conditions, body->condition_count);
    dgfem_mvci_free(&hooks, body->shapes);
    dgfem_mvci_free(&hooks, body);
}

DGFEM_API dgfem_status dgfem_mvc_create(const dgfem_mvc_desc *desc, dgfem_mvc **out) {
    dgfem_mvci_mesh *mesh;
    if (!out) return DGFEM_ERROR_ARGUMENT;
    *out = NULL;
    if (!desc || desc->cookie != DGFEM_MVC_COOKIE) return DGFEM_ERROR_DESCRIPTOR;
    dgfem_status status = dgfem_mvci_check_desc(desc);
    if (status) return status;
    dgfem_mvc *body = (dgfem_mvc *)dgfem_mvci_allocate(&desc->hooks, 1, sizeof *body);
    if (!body) return dgfem_mvci_fail_memory(&desc->hooks);
    body->desc = *desc;
    body->hooks = desc->hooks;
    status = dgfem_mvci_mesh_create(desc->mesh, &body->hooks, &mesh);
    if (!status) {
        dgfem_mvci_adopt_mesh(body, mesh);
        status = dgfem_mvci_build_topology(body, desc->mesh, NULL);
        if (!status) status = dgfem_mvci_prepare_solver(body, 0);
    }
    body->desc.mesh = NULL; /* the caller's arrays need not outlive this call */
    body->desc.materials = NULL;
    if (status) dgfem_mvc_destroy(body);
    else *out = body;
    return status;
}
