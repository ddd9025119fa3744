/* Locking in bending, section 9.5: a bar of 4 x 1 x 1, held at x = 0, under its own weight along -z.

   Linear: E = 1, rho g = 1e-3, nu = 0.3 and 0.499, all penalties and degrees. Warped: E = 2.5e6 Pa, nu = 0.3, density 1000,
   g = 9.81, where the tip moves by 1.4 of the bar's 4 m. Mean displacement of the end face. */
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
    double z[2][4][3], reference[2];
    for (int n = 0; n < 2; n++) {
        double nu = n ? 0.499 : 0.3;
        reference[n] = tip(out->quick ? 3 : 4, 3, DGFEM_PENALTY_SPLIT, nu, 0, NULL).z;
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
    paper_row(out, "reference: IP p=3, finer|%.4f|1|%.4f|1", reference[0], reference[1]);
    paper_print(out);
    dgfem_vec3 warped[4];
    paper_table(out, "Warped bar, static: tip", "method|x|z|sweeps");
    for (int degree = 1; degree <= 3; degree++) {
        int sweeps;
        warped[degree] = tip(2, degree, DGFEM_PENALTY_SPLIT, 0.3, 1, &sweeps);
        paper_row(out, "IP p=%d, 8 x 2 x 2|%.4f|%.4f|%d", degree, warped[degree].x, warped[degree].z, sweeps);
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
    paper_row(out, "converged: tip|%.4f, %.4f|-|-0.399, -0.382", reference[0], reference[1]);
    paper_row(out, "warped, p=1: tip (x, z)|%.4f, %.4f|-|-0.2858, -1.4375", warped[1].x, warped[1].z);
    paper_row(out, "warped, p=3: tip (x, z)|%.4f, %.4f|-|-0.2835, -1.4315: continuous quadratic boxes", warped[3].x,
              warped[3].z);
    paper_print(out);
    paper_end(out);
    return 0;
}
