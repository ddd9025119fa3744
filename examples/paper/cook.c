/* Cook's membrane: the panel (0,0) (48,44) (48,60) (0,44), held at x = 0, sheared at x = 48 by 1/16 per unit of height
   and thickness, upward. A slab of one layer of tapered boxes with symmetry faces on both sides is in plane strain. A
   is the middle of the loaded edge, (48, 52), C its upper end, (48, 60). Linear elasticity.

   Published converged values:
     nu = 1/3, plane stress, E = 1: u_y(A) = 23.96, the usual value for R. D. Cook, "Improved two-dimensional finite
     element",
       J. Struct. Div. ASCE 100 (1974). Plane strain with E' = E (1 + 2 nu) / (1 + nu)^2 = 15/16 and nu' = nu / (1 + nu)
       = 1/4 has the same in-plane solution.
     nu = 1/3, plane strain, E = 70, F = 100: u_y(C) = 32.27 (CalculiX), 32.20 (Code_Aster), 32.28 (Elmer), the CoFEA
       initiative's benchmark 002, cofea.readthedocs.io.
     nu = 0.499999975, plane strain, E = 1.12499998125 (mu = 3/8): u_y(A) = 16.442, as used with F. Auricchio, L. Beirao
       da Veiga, C. Lovadina, A. Reali, "An analysis of some mixed-enhanced finite element for plane linear elasticity",
       Comput. Methods Appl. Mech. Eng. 194 (2005). The value depends on mu alone near nu = 1/2, so it stands for
       nu = 0.4999 with the same mu too; our own value, of degree 3 on a mesh graded towards the singular corners, is
       beside it. */
#include "paper.h"

/* Graded: cells shrink towards all four edges, for the singular corners. */
static double fraction(int i, int n, int graded) {
    return graded ? 0.5 - 0.5 * cos(3.14159265358979323846 * i / n) : (double)i / n;
}

static dgfem_vec3 place(int n, int graded, int i, int j, int k) {
    double x = fraction(i, n, graded), y = fraction(j, n, graded), low = 44 * x, high = 44 + 16 * x,
           thickness = 40.0 / n;
    return vec3(48 * x, low + (high - low) * y, thickness * k);
}

static dgfem_mesh *membrane(int n, int graded) {
    static const int start[7] = {0, 4, 8, 12, 16, 20, 24};
    static const int loops[24] = {0, 4, 6, 2, 1, 3, 7, 5, 0, 1, 5, 4, 2, 6, 7, 3, 0, 2, 3, 1, 4, 5, 7, 6};
    dgfem_polyhedron **parts = (dgfem_polyhedron **)need_memory((size_t)(n * n), sizeof *parts);
    dgfem_weld_desc weld = dgfem_default_weld_desc();
    dgfem_mesh *mesh;
    for (int e = 0; e < n * n; e++) {
        dgfem_polyhedron_desc desc = dgfem_default_polyhedron_desc();
        dgfem_vec3 v[8];
        for (int c = 0; c < 8; c++) v[c] = place(n, graded, e % n + c % 2, e / n + c / 2 % 2, c / 4);
        desc.vertices = v, desc.vertex_count = 8;
        desc.face_count = 6, desc.loop_start = start, desc.loop_vertices = loops;
        desc.hooks = paper_hooks();
        need(dgfem_polyhedron_create(&desc, &parts[e]), "box");
    }
    weld.hooks = paper_hooks();
    need(dgfem_mesh_create_polyhedra((const dgfem_polyhedron *const *)parts, n * n, &weld, &mesh), "membrane");
    for (int e = 0; e < n * n; e++) dgfem_polyhedron_destroy(parts[e]);
    free(parts);
    return mesh;
}

typedef struct setting {
    const char *name;
    double young, poisson, traction;
    const char *published_a, *published_c;
} setting;

typedef struct result {
    int definite; /* 0: the matrix was not positive definite to round-off; a and c are NaN */
    double a, c;  /* u_y */
} result;

/* Mean over the elements at (48, y): two in the middle of the edge, one at its end. */
static double vertical(const dgfem_body *body, int n, double y) {
    dgfem_vec3 x = vec3(48, y, 20.0 / n);
    double upper = y > 59 ? n - 1 : n / 2, lower = y > 59 ? n - 1 : (n - 1) / 2;
    int e[2];
    e[0] = n - 1 + n * (int)upper, e[1] = n - 1 + n * (int)lower;
    return 0.5 * (dgfem_body_displacement(body, e[0], x).y + dgfem_body_displacement(body, e[1], x).y);
}

static result solve(const setting *s, int n, int degree, int graded) {
    dgfem_body_desc desc = linear_desc(s->young, s->poisson);
    result r;
    int count, *faces;
    desc.degree = degree;
    if (graded) desc.hooks.log = NULL; /* main() deals with failure */
    dgfem_body *body = body_of(desc, membrane(n, graded));
    hold_plane(body, plane(1, 0, 0, 0));
    for (int side = 0; side < 2; side++) {
        faces = faces_on(body->mesh, plane(0, 0, 1, side * 40.0 / n), &count);
        need(dgfem_body_fix_normal(body, faces, count, NULL), "fix_normal");
        free(faces);
    }
    faces = faces_on(body->mesh, plane(1, 0, 0, 48), &count);
    need(dgfem_body_set_traction(body, faces, count, vec3(0, s->traction, 0), NULL), "set_traction");
    free(faces);
    r.definite = solve_linear(body, NULL);
    r.a = r.definite ? vertical(body, n, 52) : (double)NAN;
    r.c = r.definite ? vertical(body, n, 60) : (double)NAN;
    dgfem_body_destroy(body);
    return r;
}

int main(int argc, char **argv) {
    static const setting settings[4] = {
        {"nu = 1/3, plane stress (as plane strain)", 0.9375, 0.25, 1.0 / 16, "23.96", "-"},
        {"nu = 1/3, plane strain", 70, 1.0 / 3, 6.25, "-", "32.27, 32.20, 32.28"},
        {"nu = 0.4999, plane strain", 0.75 * 1.4999, 0.4999, 1.0 / 16, "16.442", "-"},
        {"nu = 0.499999975, plane strain", 1.12499998125, 0.499999975, 1.0 / 16, "16.442", "-"}};
    static const int levels[4] = {4, 8, 16, 32};
    program options = program_begin(argc, argv, "cook [--csv FILE] [--markdown] [--quick]");
    paper *out = paper_begin(&options);
    int count = out->quick ? 2 : 4;
    result r[4][4][4], reference[4];
    memset(reference, 0, sizeof reference);
    for (int k = 0; k < 4; k++) {
        char title[120];
        snprintf(title, sizeof title, "Cook's membrane, %s: vertical displacement of A and C", settings[k].name);
        paper_table(out, title, "n|p=1: A|C|p=2: A|C|p=3: A|C");
        for (int l = 0; l < count; l++) {
            for (int degree = 1; degree <= 3; degree++) r[k][l][degree] = solve(&settings[k], levels[l], degree, 0);
            const result *x = r[k][l];
            paper_row(out, "%d^2|%.4f|%.4f|%.4f|%.4f|%.4f|%.4f", levels[l], x[1].a, x[1].c, x[2].a, x[2].c, x[3].a,
                      x[3].c);
        }
        for (int l = 0; l < count; l++) {
            result graded = solve(&settings[k], levels[l], 3, 1);
            if (graded.definite) {
                reference[k] = graded;
                paper_row(out, "%d^2 graded|-|-|-|-|%.4f|%.4f", levels[l], graded.a, graded.c);
            } else {
                paper_row(out, "%d^2 graded|-|-|-|-|not definite|-", levels[l]);
            }
        }
        paper_print(out);
    }
    int level = count > 2 ? 2 : 1;
    char title[120];
    snprintf(title, sizeof title, "Cook's membrane row by row: %d^2 boxes, and p=3 on the finest graded mesh",
             levels[level]);
    paper_table(out, title, "setting, point|p=1|p=2|p=3, graded|published");
    for (int k = 0; k < 4; k++) {
        const result *x = r[k][level], *y = &reference[k];
        paper_row(out, "%s, A|%.3f|%.3f|%.3f|%s", settings[k].name, x[1].a, x[2].a, y->a, settings[k].published_a);
        paper_row(out, "%s, C|%.3f|%.3f|%.3f|%s", settings[k].name, x[1].c, x[2].c, y->c, settings[k].published_c);
    }
    paper_print(out);
    paper_note("With nu = 0.499999975 (lambda / mu = 2e7) the matrices of the finer graded meshes are not positive "
               "definite to round-off; 8^2 boxes are not enough for a reference there.");
    paper_end(out);
    return 0;
}
