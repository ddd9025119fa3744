/* Table 1: matrix sizes and times of one linear static solve of a cube: 10^3 cells with BZ and IP, linear and
   quadratic, and trilinear continuous elements on 15^3 cells, which have as many unknowns as the linear ones.

     share      numbers of the matrix that are not zero to round-off, of all size^2
     integrate  all element and face integrals, by moments (CG: 2^3 Gauss points)
     assemble   the matrix from them
     solve      numerical factorization and solution; the analysis of the pattern, once per topology, stands beside it

   Times are processor times of one core. The paper's are of an Intel Core2 Duo at 2.4 GHz. */
#include "cg.h"

typedef struct row {
    const char *name;
    dgfem_flux flux;
    dgfem_penalty penalty;
    int degree; /* 0: continuous */
    double paper_share, paper_integrate, paper_assemble, paper_solve;
} row;

typedef struct figures {
    int cells, dofs;
    double share, integrate, analyse, assemble, solve;
} figures;

static figures measure_continuous(int cells) {
    cg c = cg_boxes(vec3(0, 0, 0), vec3(1, 1, 1), cells, cells, cells);
    figures f;
    cg_hold_plane(&c, plane(0, 0, 1, 1));
    cg_solve(&c, 1, 0.3, vec3(0, 0, -1));
    f.cells = cells, f.dofs = c.matrix->size;
    f.share = matrix_share(c.matrix);
    f.integrate = c.seconds_integrate, f.analyse = c.seconds_analyse, f.assemble = c.seconds_assemble;
    f.solve = c.seconds_factor + c.seconds_solve;
    cg_free(&c);
    return f;
}

/* With PCG as solver no pattern is analysed: what creation takes then is the integrals. */
static double integration_time(dgfem_body_desc desc, int cells) {
    dgfem_mesh *mesh = grid_mesh(vec3(0, 0, 0), vec3(1, 1, 1), cells, cells, cells);
    desc.solver = DGFEM_SOLVER_PCG;
    double start = cpu_seconds(NULL);
    dgfem_body *body = body_of(desc, mesh);
    double seconds = cpu_seconds(NULL) - start;
    dgfem_body_destroy(body);
    return seconds;
}

static double analysis_time(const dgfem_matrix *matrix) {
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_cholesky *cholesky;
    double start = cpu_seconds(NULL);
    need(dgfem_cholesky_create(matrix, &desc, &cholesky), "Cholesky");
    double seconds = cpu_seconds(NULL) - start;
    dgfem_cholesky_destroy(cholesky);
    return seconds;
}

static figures measure(const row *r, int cells) {
    dgfem_body_desc desc = linear_desc(1, 0.3);
    dgfem_step_info info;
    figures f;
    if (!r->degree) return measure_continuous(cells * 3 / 2);
    desc.flux = r->flux, desc.penalty = r->penalty, desc.degree = r->degree;
    if (r->flux == DGFEM_FLUX_BZ) desc.eta = 20;
    desc.gravity = vec3(0, 0, -1);
    f.integrate = integration_time(desc, cells);
    dgfem_body *body = body_of(desc, grid_mesh(vec3(0, 0, 0), vec3(1, 1, 1), cells, cells, cells));
    f.analyse = analysis_time(body->matrix);
    hold_plane(body, plane(0, 0, 1, 1));
    if (!solve_linear(body, &info)) need(DGFEM_ERROR_NOT_POSITIVE_DEFINITE, r->name);
    f.cells = cells, f.dofs = 3 * body->basis_count;
    f.share = matrix_share(body->matrix);
    f.assemble = info.seconds_assemble;
    f.solve = info.seconds_factor + info.seconds_solve;
    dgfem_body_destroy(body);
    return f;
}

int main(int argc, char **argv) {
    static const row rows[] = {{"BZ linear", DGFEM_FLUX_BZ, DGFEM_PENALTY_SCALAR, 1, 0.28, 532, 22, 656},
                               {"IP linear", DGFEM_FLUX_IP, DGFEM_PENALTY_SCALAR, 1, 0.62, 1437, 87, 734},
                               {"CG trilinear", DGFEM_FLUX_IP, DGFEM_PENALTY_SCALAR, 0, 0.58, 3750, 41, 641},
                               {"BZ quadratic", DGFEM_FLUX_BZ, DGFEM_PENALTY_SCALAR, 2, 0.28, 3062, 152, 7797},
                               {"IP quadratic", DGFEM_FLUX_IP, DGFEM_PENALTY_SCALAR, 2, 0.64, 8344, 621, 8484},
                               {"IP linear, split penalty", DGFEM_FLUX_IP, DGFEM_PENALTY_SPLIT, 1, 0, 0, 0, 0},
                               {"IP quadratic, split penalty", DGFEM_FLUX_IP, DGFEM_PENALTY_SPLIT, 2, 0, 0, 0, 0}};
    enum { ROWS = sizeof rows / sizeof *rows };
    program p = program_begin(argc, argv, "table1 [--csv FILE] [--markdown] [--quick]");
    paper *out = paper_begin(&p);
    figures f[ROWS];
    for (int i = 0; i < ROWS; i++) f[i] = measure(&rows[i], out->quick ? 4 : 10);
    paper_table(out, "Table 1 row by row: ours and the paper's (times in ms)",
                "method|cells|unknowns|share %|paper|integrate|paper|assemble|paper|analyse|solve|paper");
    for (int i = 0; i < ROWS; i++) {
        const row *r = &rows[i];
        char theirs[4][16];
        const double values[4] = {r->paper_share, r->paper_integrate, r->paper_assemble, r->paper_solve};
        for (int k = 0; k < 4; k++) snprintf(theirs[k], sizeof theirs[k], values[k] > 0 ? "%g" : "-", values[k]);
        paper_row(out, "%s|%d^3|%d|%.2f|%s|%.1f|%s|%.1f|%s|%.1f|%.1f|%s", r->name, f[i].cells, f[i].dofs,
                  100 * f[i].share, theirs[0], 1e3 * f[i].integrate, theirs[1], 1e3 * f[i].assemble, theirs[2],
                  1e3 * f[i].analyse, 1e3 * f[i].solve, theirs[3]);
    }
    paper_print(out);
    paper_note("The paper's unknowns: 12k and 30k. Polynomials centred in their elements leave more zeros than the "
               "paper's global monomials.");
    paper_end(out);
    return 0;
}
