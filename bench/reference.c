#define DGFEM_REAL double
#define DGFEM_STATIC
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "box.h"
#include "reference.h"

void reference_tip(const int *cells, int steps, double (*tip)[3]) {
    box b = bar_of(cells, DGFEM_SOLVER_CHOLESKY);
    dgfem_body *body = box_body(&b);
    for (int i = 0; i < steps; i++) {
        expect(dgfem_body_step(body, 1.0 / 60, NULL) == DGFEM_OK, "dgfem_body_step");
        box_tip(body, b.size[0], tip[i]);
    }
    dgfem_body_destroy(body);
}
