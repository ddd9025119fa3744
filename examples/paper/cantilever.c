/* Locking in bending, section 9.5: a bar of 4 x 1 x 1, held at x = 0, under its own weight along -z.

   Linear: E = 1, rho g = 1e-3, nu = 0.3 and 0.499, all penalties and degrees. Warped: E = 2.5e6 Pa, nu = 0.3, density
   1000, g = 9.81, where the tip moves by 1.4 of the bar's 4 m. Mean displacement of the end face.

   The held face has singular edges, so the reference, of degree 3, is graded: boxes are halved again and again towards
   the held face and the sides. The sheet's -0.399 and -0.382, of 16 x 4 x 4 boxes, are a little short of it. */
#include "cg.h"

static dgfem_body *bar(int n, int degree, dgfem_penalty penalty, double poisson, int warp) {
    dgfem_body_desc desc = linear_desc(warp ? 2.5e6 : 1, poisson);
    desc.degree = degree, desc.penalty = penalty, desc.warp = warp;
    desc.material.density = warp ? 1000 : 1;
    desc.gravity = vec3(0, 0, warp ? -9.81 : -1e-3);
    dgfem_body *body = body_of(desc, grid_mesh(vec3(0, 0, 0), vec3(4, 1, 1), 4 * n, n, n));
    hold_plane(body, plane(1, 0, 0, 0));
    return body;
}

/* The linear bar with p = 3 on 8 x 2 x 2 boxes, those along the held face and the sides halved so many times. */
static double graded_tip(int halvings, double poisson, int *dofs) {
    dgfem_mesh *mesh = grid_mesh(vec3(0, 0, 0), vec3(4, 1, 1), 8, 2, 2);
    for (double h = 0.25; halvings > 0; h /= 2, halvings--) {
        const dgfem_plane cuts[5] = {plane(1, 0, 0, h), plane(0, 1, 0, h), plane(0, 1, 0, 1 - h), plane(0, 0, 1, h),
                                     plane(0, 0, 1, 1 - h)};
        for (int k = 0; k < 5; k++) need(dgfem_mesh_split_plane(mesh, cuts[k], 0, NULL), "split");
    }
    dgfem_body_desc desc = linear_desc(1, poisson);
    desc.degree = 3;
    desc.gravity = vec3(0, 0, -1e-3);
    dgfem_body *body = body_of(desc, mesh);
    hold_plane(body, plane(1, 0, 0, 0));
    if (!solve_linear(body, NULL)) need(DGFEM_ERROR_NOT_POSITIVE_DEFINITE, "graded bar");
    double z = mean_on(body, plane(1, 0, 0, 4)).z;
    *dofs = 3 * body->basis_count;
    dgfem_body_destroy(body);
    return z;
}

static dgfem_vec3 tip(int n, int degree, dgfem_penalty penalty, double poisson, int warp, int *sweeps) {
    dgfem_body *body = bar(n, degree, penalty, poisson, warp);
    dgfem_static_desc desc = dgfem_default_static_desc();
    dgfem_step_info info;
    dgfem_vec3 u;
    if (warp) desc.load_steps = 4;
    need(dgfem_body_solve_static(body, &desc, &info), "bar");
    if (sweeps) *sweeps = info.sweeps;
    u = mean_on(body, plane(1, 0, 0, 4));
    dgfem_body_destroy(body);
    return u;
}

static double continuous_tip(int n, double poisson) {
    cg c = cg_boxes(vec3(0, 0, 0), vec3(4, 1, 1), 4 * n, n, n);
    cg_hold_plane(&c, plane(1, 0, 0, 0));
    cg_solve(&c, 1, poisson, vec3(0, 0, -1e-3));
    double z = cg_mean_on(&c, plane(1, 0, 0, 4)).z;
    cg_free(&c);
    return z;
}

int main(int argc, char **argv) {
    static const char *const names[3] = {"split (default)", "tensor", "scalar (the paper's)"};
    program options = program_begin(argc, argv, "cantilever [--csv FILE] [--markdown] [--quick]");
    paper *out = paper_begin(&options);
    double z[2][4][3], graded[2][4], reference[2];
    int halvings = out->quick ? 1 : 3, dofs[4];
    for (int n = 0; n < 2; n++) {
        double nu = n ? 0.499 : 0.3;
        for (int k = 0; k <= halvings; k++) graded[n][k] = graded_tip(k, nu, &dofs[k]);
        reference[n] = graded[n][halvings];
        for (int degree = 1; degree <= 3; degree++)
            for (int k = 0; k < 3; k++) z[n][degree][k] = tip(2, degree, (dgfem_penalty)k, nu, 0, NULL).z;
    }
    paper_table(out, "Linear bar, 8 x 2 x 2 boxes: tip, and its ratio to the converged one",
                "method|nu .3|ratio|nu .499|ratio");
    for (int degree = 1; degree <= 3; degree++)
        for (int k = 0; k < 3; k++)
            paper_row(out, "IP p=%d %s|%.4f|%.3f|%.4f|%.3f", degree, names[k], z[0][degree][k],
                      z[0][degree][k] / reference[0], z[1][degree][k], z[1][degree][k] / reference[1]);
    double cg0 = continuous_tip(2, 0.3), cg1 = continuous_tip(2, 0.499);
    paper_row(out, "CG trilinear|%.4f|%.3f|%.4f|%.3f", cg0, cg0 / reference[0], cg1, cg1 / reference[1]);
    paper_row(out, "reference: IP p=3, graded, %d unknowns|%.4f|1|%.4f|1", dofs[halvings], reference[0], reference[1]);
    paper_print(out);
    paper_table(out, "Convergence of the reference", "boxes|unknowns|nu .3|nu .499");
    for (int k = 0; k <= halvings; k++)
        paper_row(out, "8 x 2 x 2, %d halvings|%d|%.5f|%.5f", k, dofs[k], graded[0][k], graded[1][k]);
    paper_print(out);
    dgfem_vec3 warped[4], fine;
    int sweeps;
    paper_table(out, "Warped bar, static: tip", "method|x|z|sweeps");
    for (int degree = 1; degree <= 3; degree++) {
        warped[degree] = tip(2, degree, DGFEM_PENALTY_SPLIT, 0.3, 1, &sweeps);
        paper_row(out, "IP p=%d, 8 x 2 x 2|%.4f|%.4f|%d", degree, warped[degree].x, warped[degree].z, sweeps);
    }
    fine = warped[2];
    for (int degree = 1; degree <= 2; degree++)
        for (int n = 3; n <= (out->quick ? 0 : 4); n++) {
            fine = tip(n, degree, DGFEM_PENALTY_SPLIT, 0.3, 1, &sweeps);
            paper_row(out, "IP p=%d, %d x %d x %d|%.4f|%.4f|%d", degree, 4 * n, n, n, fine.x, fine.z, sweeps);
        }
    paper_print(out);
    paper_table(out, "Bending row by row", "quantity|ours|paper|expected");
    paper_row(out, "p=1, default penalty, nu = .3: tip|%.4f|no locking|-0.402", z[0][1][0]);
    paper_row(out, "p=1, default penalty, nu = .499: tip|%.4f|no locking|-0.404", z[1][1][0]);
    paper_row(out, "p=1, default penalty: ratio to converged|%.3f, %.3f|-|within 6 %%", z[0][1][0] / reference[0],
              z[1][1][0] / reference[1]);
    paper_row(out, "p=1, scalar penalty: ratio to converged|%.3f, %.3f|no locking|locks", z[0][1][2] / reference[0],
              z[1][1][2] / reference[1]);
    paper_row(out, "p=2, default penalty: ratio to converged|%.3f, %.3f|-|within 5 %%", z[0][2][0] / reference[0],
              z[1][2][0] / reference[1]);
    paper_row(out, "p=2, default penalty: ratio to -0.399, -0.382|%.3f, %.3f|-|within 5 %%", -z[0][2][0] / 0.399,
              -z[1][2][0] / 0.382);
    paper_row(out, "converged: tip|%.4f, %.4f|-|-0.399, -0.382", reference[0], reference[1]);
    paper_row(out, "warped, p=1: tip (x, z)|%.4f, %.4f|-|-0.2858, -1.4375", warped[1].x, warped[1].z);
    paper_row(out, "warped, p=2, finest: tip (x, z)|%.4f, %.4f|-|-0.2835, -1.4315: continuous quadratic boxes", fine.x,
              fine.z);
    paper_print(out);
    paper_end(out);
    return 0;
}
