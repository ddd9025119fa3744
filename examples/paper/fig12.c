/* Fig. 12: a locally thin feature. A single non-convex element, 2 x 1 x 1, narrowed to the height eps in the middle,
   held at one end:

        +-_        _-+
        |   -_  _-   |
        |     ==     |  eps
        |   -    -   |
        +-          -+

   Its volume stays large, so the condition number of its stiffness matrix stays finite as eps goes to zero. */
#include "paper.h"

static dgfem_mesh *narrowed(double eps) {
    static const int start[9] = {0, 6, 12, 16, 20, 24, 28, 32, 36};
    static const double outline[6][2] = {{0, 0}, {1, 0.5}, {2, 0}, {2, 1}, {1, 0.5}, {0, 1}};
    dgfem_polyhedron_desc desc = dgfem_default_polyhedron_desc();
    dgfem_weld_desc weld = dgfem_default_weld_desc();
    dgfem_polyhedron *p;
    dgfem_mesh *mesh;
    dgfem_vec3 vertices[12];
    int loops[36];
    for (int i = 0; i < 12; i++) {
        double z = outline[i % 6][1];
        if (i % 6 == 1) z -= 0.5 * eps;
        if (i % 6 == 4) z += 0.5 * eps;
        vertices[i] = vec3(outline[i % 6][0], i / 6, z);
    }
    for (int i = 0; i < 6; i++) {
        loops[i] = i;          /* y = 0 */
        loops[6 + i] = 11 - i; /* y = 1 */
        int next = (i + 1) % 6, *quad = loops + 12 + 4 * i;
        quad[0] = next, quad[1] = i, quad[2] = 6 + i, quad[3] = 6 + next;
    }
    desc.vertices = vertices, desc.vertex_count = 12;
    desc.face_count = 8, desc.loop_start = start, desc.loop_vertices = loops;
    desc.hooks = weld.hooks = paper_hooks();
    weld.tolerance = 1e-13;
    need(dgfem_polyhedron_create(&desc, &p), "polyhedron");
    need(dgfem_mesh_create_polyhedra((const dgfem_polyhedron *const *)&p, 1, &weld, &mesh), "mesh");
    dgfem_polyhedron_destroy(p);
    return mesh;
}

typedef struct conditions {
    double volume, raw, scaled;
} conditions;

static conditions measure(double eps, int degree) {
    dgfem_body_desc desc = linear_desc(1, 0.3);
    conditions c;
    desc.degree = degree;
    desc.gravity = vec3(0, 0, -1);
    dgfem_body *body = body_of(desc, narrowed(eps));
    hold_plane(body, plane(1, 0, 0, 0));
    if (!solve_linear(body, NULL)) need(DGFEM_ERROR_NOT_POSITIVE_DEFINITE, "narrowed element");
    c.volume = dgfem_mesh_volume(body->mesh);
    c.raw = matrix_condition(body->matrix, 0);
    c.scaled = matrix_condition(body->matrix, 1);
    dgfem_body_destroy(body);
    return c;
}

int main(int argc, char **argv) {
    static const double heights[] = {1, 0.3, 0.1, 0.03, 0.01, 1e-3, 1e-4, 1e-6, 1e-8};
    enum { HEIGHTS = sizeof heights / sizeof *heights };
    program options = program_begin(argc, argv, "fig12 [--csv FILE] [--markdown] [--quick]");
    paper *out = paper_begin(&options);
    conditions c[HEIGHTS][4];
    paper_table(out, "Condition numbers of one element, IP, default penalty (Jacobi: after scaling by the diagonal)",
                "eps|volume|p=1 raw|p=1 Jacobi|p=2 raw|p=2 Jacobi|p=3 raw|p=3 Jacobi");
    for (int i = 0; i < HEIGHTS; i++) {
        for (int degree = 1; degree <= 3; degree++) c[i][degree] = measure(heights[i], degree);
        paper_row(out, "%g|%.6f|%.1f|%.2f|%.1f|%.1f|%.4g|%.4g", heights[i], c[i][1].volume, c[i][1].raw, c[i][1].scaled,
                  c[i][2].raw, c[i][2].scaled, c[i][3].raw, c[i][3].scaled);
    }
    paper_print(out);
    paper_table(out, "Fig. 12 row by row", "quantity|ours|paper|expected");
    paper_row(out, "p=1: limit of the condition number, raw|%.1f|stays finite|530.7, other dimensions",
              c[HEIGHTS - 1][1].raw);
    paper_row(out, "p=1: change from eps = 1e-4 to 1e-8|%.1e|none|none",
              fabs(c[HEIGHTS - 1][1].raw / c[HEIGHTS - 3][1].raw - 1));
    paper_row(out, "p=3: limit of the condition number, Jacobi|%.3g|stays finite|finite", c[HEIGHTS - 1][3].scaled);
    paper_print(out);
    paper_end(out);
    return 0;
}
