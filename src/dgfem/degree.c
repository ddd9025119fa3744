#pragma once
#include "query.c"
/* Changing the polynomial degree of elements while the body lives: coefficients are kept exactly when the degree is
   raised and L2-projected when it is lowered; integrals of what did not change are kept. */

/* u_new of one element. The new basis is the first part of the old one or the other way round, so raising adds zeros
   and lowering solves M_new u_new = (first rows of M_old) u_old, with M_new the first rows and columns of M_old. */
static void dgfemi_project_degree(const dgfem_real *mass, int n_old, int n_new, const dgfem_vec3 *old,
                                  dgfem_vec3 *out) {
    dgfem_real m[DGFEM_MAX_BASIS * DGFEM_MAX_BASIS];
    memset(out, 0, (size_t)n_new * sizeof *out);
    if (n_new >= n_old) {
        memcpy(out, old, (size_t)n_old * sizeof *out);
        return;
    }
    for (int i = 0; i < n_new; i++) {
        memcpy(m + i * n_new, mass + i * n_old, (size_t)n_new * sizeof *m);
        for (int j = 0; j < n_old; j++) out[i] = dgfemi_add_scaled(out[i], mass[i * n_old + j], old[j]);
    }
    int ok = dgfemi_cholesky_dense(m, n_new); /* factored as part of the old mass matrix before */
    DGFEM_ASSERT(ok);
    (void)ok;
    dgfemi_cholesky_dense_solve(m, n_new, (dgfem_real *)(void *)out, 3);
}

/* The new forms of a face: copied where both sides kept their degree, else integrated, with the ghost of a held face
   carried over. 0 when out of memory. */
static int dgfemi_renew_face_form(const dgfem_body *old, const dgfem_body *body, const dgfemi_face_form *from,
                                  dgfemi_face_form *to) {
    int a = from->element[0], b = from->element[1];
    *to = *from;
    if (old->degree[a] == body->degree[a] && (b == DGFEM_NONE || old->degree[b] == body->degree[b])) {
        size_t size = dgfemi_face_form_size(from);
        if (!dgfemi_forms_take(body->forms, &body->hooks, size, &to->data)) return 0;
        memcpy(body->forms->data + to->data, old->forms->data + from->data, size * sizeof(dgfem_real));
        return 1;
    }
    if (!dgfemi_forms_set_face(body, body->forms, to)) return 0;
    if (b == DGFEM_NONE) {
        int kept = from->count[1] < to->count[1] ? from->count[1] : to->count[1];
        memcpy(dgfemi_form_ghost(body->forms, to), dgfemi_form_ghost(old->forms, from),
               (size_t)kept * sizeof(dgfem_vec3));
    }
    return 1;
}

static int dgfemi_renew_forms(const dgfem_body *old, dgfem_body *body) {
    const dgfem_hooks *hooks = &body->hooks;
    dgfem_forms *forms = (dgfem_forms *)dgfemi_allocate_zero(hooks, 1, sizeof *forms);
    body->forms = forms;
    if (!forms) return 0;
    int elements = body->mesh->element_count, faces = old->forms->face_count;
    forms->elements = (dgfemi_element_form *)dgfemi_allocate(hooks, (size_t)elements, sizeof *forms->elements);
    forms->faces = (dgfemi_face_form *)dgfemi_allocate(hooks, (size_t)faces, sizeof *forms->faces);
    if (!forms->elements || !forms->faces) return 0;
    forms->face_capacity = faces;
    for (int e = 0; e < elements; e++) {
        if (old->degree[e] != body->degree[e]) {
            if (!dgfemi_forms_set_element(body, forms, e)) return 0;
            continue;
        }
        size_t size = dgfemi_element_form_size(old->forms->elements[e].count);
        forms->elements[e] = old->forms->elements[e];
        if (!dgfemi_forms_take(forms, hooks, size, &forms->elements[e].data)) return 0;
        memcpy(forms->data + forms->elements[e].data, old->forms->data + old->forms->elements[e].data,
               size * sizeof(dgfem_real));
    }
    for (; forms->face_count < faces; forms->face_count++)
        if (!dgfemi_renew_face_form(old, body, &old->forms->faces[forms->face_count], &forms->faces[forms->face_count]))
            return 0;
    return 1;
}

static void dgfemi_project_state(const dgfem_body *old, dgfem_body *body) {
    for (int e = 0; e < body->mesh->element_count; e++) {
        const dgfem_real *mass = dgfemi_form_mass(old->forms, e);
        int from = old->basis_start[e], to = body->basis_start[e];
        int n_old = dgfemi_element_basis(old, e), n_new = dgfemi_element_basis(body, e);
        dgfemi_project_degree(mass, n_old, n_new, old->displacement + from, body->displacement + to);
        dgfemi_project_degree(mass, n_old, n_new, old->velocity + from, body->velocity + to);
    }
}

/* New values of held elements, in the order of the conditions; NULL entries for the other kinds. 0 when out of
   memory. */
static int dgfemi_renew_values(const dgfem_body *old, const dgfem_body *body, dgfem_vec3 **values) {
    for (int c = 0; c < old->condition_count; c++) {
        const dgfem_condition *condition = &old->conditions[c];
        size_t count = 0;
        if (condition->kind != DGFEM_CONDITION_FIX_ELEMENTS) continue;
        for (int i = 0; i < condition->count; i++) count += (size_t)dgfemi_element_basis(body, condition->items[i]);
        values[c] = (dgfem_vec3 *)dgfemi_allocate(&body->hooks, count, sizeof(dgfem_vec3));
        if (!values[c]) return 0;
        const dgfem_vec3 *from = condition->values;
        dgfem_vec3 *to = values[c];
        for (int i = 0; i < condition->count; i++) {
            int e = condition->items[i], n_old = dgfemi_element_basis(old, e), n_new = dgfemi_element_basis(body, e);
            dgfemi_project_degree(dgfemi_form_mass(old->forms, e), n_old, n_new, from, to);
            from += n_old, to += n_new;
        }
    }
    return 1;
}

/* Everything of the body that depends on degrees, made anew in `body`, a copy of `old` in which those members are
   NULL. */
static dgfem_status dgfemi_renew_body(const dgfem_body *old, dgfem_body *body, const int *degrees,
                                      dgfem_vec3 **values) {
    size_t n = (size_t)body->mesh->element_count;
    body->degree = (int *)dgfemi_duplicate(&body->hooks, degrees, n, sizeof(int));
    body->basis_start = (int *)dgfemi_allocate(&body->hooks, n + 1, sizeof(int));
    if (!body->degree || !body->basis_start) return DGFEM_ERROR_MEMORY;
    body->basis_start[0] = 0;
    for (size_t e = 0; e < n; e++) body->basis_start[e + 1] = body->basis_start[e] + dgfem_monomial_count(degrees[e]);
    body->basis_count = body->basis_start[n];
    if (!dgfemi_body_allocate_state(body) || !dgfemi_renew_forms(old, body)) return DGFEM_ERROR_MEMORY;
    dgfemi_project_state(old, body);
    if (!dgfemi_renew_values(old, body, values)) return DGFEM_ERROR_MEMORY;
    dgfem_status status = dgfemi_body_create_solver(body);
    if (!status && old->contacts) status = dgfemi_contacts_renew(old->contacts, body, &body->contacts);
    return status;
}

/* Frees the members that dgfemi_renew_body makes. */
static void dgfemi_free_renewed(dgfem_body *body) {
    dgfem_hooks hooks = body->hooks;
    dgfemi_free(&hooks, body->degree);
    dgfemi_free(&hooks, body->basis_start);
    dgfemi_free(&hooks, body->displacement);
    dgfemi_free(&hooks, body->velocity);
    dgfemi_free(&hooks, body->force);
    dgfemi_free(&hooks, body->work);
    dgfemi_forms_destroy(body->forms, &hooks);
    dgfemi_contacts_destroy(body->contacts);
    dgfem_matrix_destroy(body->matrix);
    dgfem_cholesky_destroy(body->cholesky);
}

static dgfem_status dgfemi_set_degrees(dgfem_body *body, const int *degrees) {
    dgfemi_arena arena = dgfemi_arena_make(&body->hooks);
    dgfem_body next = *body, last = *body;
    dgfem_vec3 **values =
        (dgfem_vec3 **)dgfemi_arena_allocate_zero(&arena, (size_t)body->condition_count, sizeof *values);
    if (!values) return dgfemi_fail_memory(&body->hooks);
    next.degree = next.basis_start = NULL;
    next.displacement = next.velocity = next.force = NULL;
    next.work = NULL, next.forms = NULL, next.contacts = NULL, next.matrix = NULL, next.cholesky = NULL;
    next.revision++; /* contact points are embedded in the new revision */
    dgfem_status status = dgfemi_renew_body(body, &next, degrees, values);
    if (status) {
        for (int c = 0; c < body->condition_count; c++) dgfemi_free(&body->hooks, values[c]);
        dgfemi_free_renewed(&next);
        dgfemi_arena_free(&arena);
        return status == DGFEM_ERROR_MEMORY ? dgfemi_fail_memory(&body->hooks) : status;
    }
    *body = next;
    for (int c = 0; c < body->condition_count; c++) {
        if (!values[c]) continue;
        dgfemi_free(&body->hooks, body->conditions[c].values);
        body->conditions[c].values = values[c];
    }
    dgfemi_update_force(body);
    dgfemi_free_renewed(&last);
    dgfemi_arena_free(&arena);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_body_set_degrees(dgfem_body *body, const int *degrees) {
    if (!body || !degrees) return DGFEM_ERROR_ARGUMENT;
    for (int e = 0; e < body->mesh->element_count; e++)
        if (degrees[e] < 1 || degrees[e] > DGFEM_MAX_DEGREE)
            return dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "element %d: degree %d, expected 1..%d", e,
                               degrees[e], DGFEM_MAX_DEGREE);
    return dgfemi_set_degrees(body, degrees);
}

DGFEM_API dgfem_status dgfem_body_set_degree(dgfem_body *body, int element, int degree) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_elements(body, &element, 1);
    if (status) return status;
    int *degrees = (int *)dgfemi_duplicate(&body->hooks, body->degree, (size_t)body->mesh->element_count, sizeof(int));
    if (!degrees) return dgfemi_fail_memory(&body->hooks);
    degrees[element] = degree;
    status = dgfem_body_set_degrees(body, degrees);
    dgfemi_free(&body->hooks, degrees);
    return status;
}
