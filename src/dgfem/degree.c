#pragma once
#include "renew.c"
/* Changing the polynomial degree of elements while the body lives: coefficients are kept exactly when the degree is
   raised and L2-projected when it is lowered. */

static dgfem_status dgfemi_check_degree(const dgfem_body *body, int element, int degree) {
    if (degree >= 1 && degree <= DGFEM_MAX_DEGREE) return DGFEM_OK;
    return dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "element %d: degree %d, expected 1..%d", element, degree,
                       DGFEM_MAX_DEGREE);
}

/* degrees[element_count], or NULL: `degree` for `element` alone. */
static dgfem_status dgfemi_set_degrees(dgfem_body *body, const int *degrees, int element, int degree) {
    dgfemi_edit edit;
    dgfem_status status = dgfemi_edit_begin(&edit, body);
    if (status) return status;
    for (int e = 0; degrees && e < body->mesh->element_count; e++) edit.fields[e].next_degree = degrees[e];
    if (!degrees) edit.fields[element].next_degree = degree;
    status = dgfemi_edit_finish(&edit, body);
    dgfemi_edit_free(&edit);
    return status;
}

DGFEM_API dgfem_status dgfem_body_set_degrees(dgfem_body *body, const int *degrees) {
    dgfem_status status = DGFEM_OK;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!degrees) return dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "set_degrees: no degrees");
    for (int e = 0; !status && e < body->mesh->element_count; e++) status = dgfemi_check_degree(body, e, degrees[e]);
    return status ? status : dgfemi_set_degrees(body, degrees, 0, 0);
}

DGFEM_API dgfem_status dgfem_body_set_degree(dgfem_body *body, int element, int degree) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_elements(body, &element, 1);
    if (!status) status = dgfemi_check_degree(body, element, degree);
    return status ? status : dgfemi_set_degrees(body, NULL, element, degree);
}
