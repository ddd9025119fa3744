/* The solvers of a step, in the order of the tables. */
#ifndef SOLVERS_H
#define SOLVERS_H

#include "bench.h"

typedef struct solver_case {
    const char *name;
    dgfem_solver solver;
} solver_case;

static const solver_case solvers[] = {
    {"auto", DGFEM_SOLVER_AUTO},
    {"stale", DGFEM_SOLVER_STALE},
    {"sweeps", DGFEM_SOLVER_SWEEPS},
    {"cholesky", DGFEM_SOLVER_CHOLESKY},
    {"pcg", DGFEM_SOLVER_PCG},
};

enum { SOLVERS = sizeof solvers / sizeof *solvers };

/* `only` names one solver, or is NULL for all. */
static inline int is_wanted(const solver_case *s, const char *only) { return !only || strcmp(only, s->name) == 0; }

static inline const char *real_name(void) { return DGFEM_REAL_IS_FLOAT ? "float" : "double"; }

#endif
