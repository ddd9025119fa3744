/* Fig. 3: from continuous elements to rigid cells. A bar of 4 x 1 x 1, held at x = 0, bends under its weight (E = 1,
   nu = 0.3, rho g = 1e-3 along -z, linear elasticity). The penalty eta is a spring between elements relative to their
   own stiffness, so the whole family appears as eta alone varies:

     eta large: on tetrahedra BZ becomes the continuous linear element;
     eta small (the same as a very stiff material with soft glue): the cells stay rigid and the glue takes all strain,
     PriMo. Its solution is found by restricting the same matrix to the six rigid motions of each cell. */
#include "cg.h"

static const double weight = 1e-3;

static dgfem_body *bar(dgfem_mesh *mesh, dgfem_flux flux, dgfem_penalty penalty, int degree, double eta) {
    dgfem_body_desc desc = linear_desc(1, 0.3);
    desc.flux = flux, desc.penalty = penalty, desc.degree = degree, desc.eta = eta;
    desc.gravity = vec3(0, 0, -weight);
    dgfem_body *body = body_of(desc, mesh);
    hold_plane(body, plane(1, 0, 0, 0));
    return body;
}

static double tip(const dgfem_body *body) { return mean_on(body, plane(1, 0, 0, 4)).z; }

/* Root mean square of the jump at the corners of all glued faces. */
static double jump(const dgfem_body *body) {
    const dgfem_mesh *mesh = body->mesh;
    double sum = 0, count = 0;
    for (int f = 0; f < mesh->face_count; f++) {
        const dgfem_face *face = &mesh->faces[f];
        if (face->element[1] == DGFEM_NONE) continue;
        dgfem_loop loop = mesh->loops[face->loop_start];
        for (int i = loop.start; i < loop.start + loop.count; i++, count++) {
            dgfem_vec3 x = mesh->vertices[mesh->loop_vertices[i]];
            dgfem_vec3 a = dgfem_body_displacement(body, face->element[0], x);
            dgfem_vec3 b = dgfem_body_displacement(body, face->element[1], x);
            sum += (a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y) + (a.z - b.z) * (a.z - b.z);
        }
    }
    return sqrt(sum / count);
}

/* Share of the elastic energy that the elements hold; the glue has the rest. Degree 1: strains are constant. */
static double element_share(const dgfem_body *body) {
    dgfem_energy energy;
    double sum = 0;
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfem_vec3 x = body->mesh->elements[e].centre;
        dgfem_mat3 s = dgfem_body_stress(body, e, x), f = dgfem_body_gradient(body, e, x);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                sum += 0.5 * body->mesh->elements[e].volume * s.m[i][j] * (f.m[i][j] - (i == j));
    }
    need(dgfem_body_energy(body, &energy), "energy");
    return sum / energy.elastic;
}

/* Coefficient vectors (degree 1: 12 numbers) of the six rigid motions of an element: translations, then rotations about
   its centroid. */
static void rigid_motions(const dgfem_body *body, int element, double r[12][6]) {
    double s = body->scale[element];
    memset(r, 0, 12 * sizeof r[0]);
    for (int a = 0; a < 3; a++) {
        int b = (a + 1) % 3, c = (a + 2) % 3;
        r[a][a] = 1;
        r[3 * (1 + b) + c][3 + a] = s; /* e_a x e_b = e_c */
        r[3 * (1 + c) + b][3 + a] = -s;
    }
}

/* Tip displacement of the rigid cells: R^T K R q = R^T F. */
static double rigid_tip(dgfem_body *body) {
    const dgfem_matrix *k = body->matrix;
    dgfem_matrix_desc desc = dgfem_default_matrix_desc();
    dgfem_matrix *rigid;
    int n = body->mesh->element_count, blocks = k->row_start[n], pair = 0;
    int *sizes = (int *)need_memory((size_t)n, sizeof *sizes);
    int *pairs = (int *)need_memory(2 * (size_t)blocks, sizeof *pairs);
    double *q = need_reals(6 * (size_t)n), left[12][6], right[12][6];
    for (int r = 0; r < n; r++) {
        sizes[r] = 6;
        for (int b = k->row_start[r]; b < k->row_start[r + 1]; b++) pairs[pair++] = r, pairs[pair++] = k->column[b];
        q[6 * r + 2] = -weight * body->mesh->elements[r].volume; /* about the centroid: no moment */
    }
    desc.block_count = n, desc.block_sizes = sizes;
    desc.pairs = pairs, desc.pair_count = blocks;
    desc.hooks = paper_hooks();
    need(dgfem_matrix_create(&desc, &rigid), "matrix");
    for (int r = 0; r < n; r++)
        for (int b = k->row_start[r]; b < k->row_start[r + 1]; b++) {
            const double *block = dgfem_matrix_block(k, r, k->column[b]);
            double *out = dgfem_matrix_block(rigid, r, k->column[b]);
            rigid_motions(body, r, left);
            rigid_motions(body, k->column[b], right);
            for (int i = 0; i < 12; i++)
                for (int j = 0; j < 12; j++)
                    for (int c = 0; c < 36; c++) out[c] += left[i][c / 6] * block[12 * i + j] * right[j][c % 6];
        }
    if (!matrix_solve(rigid, q, q)) need(DGFEM_ERROR_NOT_POSITIVE_DEFINITE, "rigid cells");
    for (int r = 0; r < n; r++) {
        double *u = (double *)(void *)(body->displacement + body->basis_start[r]);
        rigid_motions(body, r, left);
        for (int i = 0; i < 12; i++) {
            u[i] = 0;
            for (int c = 0; c < 6; c++) u[i] += left[i][c] * q[6 * r + c];
        }
    }
    dgfem_matrix_destroy(rigid);
    free(sizes);
    free(pairs);
    free(q);
    return tip(body);
}

static double continuous_tip(cg c) {
    cg_hold_plane(&c, plane(1, 0, 0, 0));
    cg_solve(&c, 1, 0.3, vec3(0, 0, -weight));
    double result = cg_mean_on(&c, plane(1, 0, 0, 4)).z;
    cg_free(&c);
    return result;
}

typedef struct family {
    double tip, rigid, jump, share;
} family;

static family solve(const kuhn *k, double eta) {
    family f;
    dgfem_body *body = bar(kuhn_mesh(k), DGFEM_FLUX_BZ, DGFEM_PENALTY_SCALAR, 1, eta);
    if (!solve_linear(body, NULL)) need(DGFEM_ERROR_NOT_POSITIVE_DEFINITE, "bar");
    f.tip = tip(body);
    f.jump = jump(body);
    f.share = element_share(body);
    f.rigid = rigid_tip(body);
    dgfem_body_destroy(body);
    return f;
}

static double default_tip(dgfem_mesh *mesh, int degree) {
    dgfem_body *body = bar(mesh, DGFEM_FLUX_IP, DGFEM_PENALTY_SPLIT, degree, 4);
    if (!solve_linear(body, NULL)) need(DGFEM_ERROR_NOT_POSITIVE_DEFINITE, "bar");
    double result = tip(body);
    dgfem_body_destroy(body);
    return result;
}

static dgfem_mesh *boxes(int n) { return grid_mesh(vec3(0, 0, 0), vec3(4, 1, 1), 4 * n, n, n); }

int main(int argc, char **argv) {
    program p = program_begin(argc, argv, "fig3 [--csv FILE] [--markdown] [--quick]");
    paper *out = paper_begin(&p);
    kuhn k = kuhn_create(vec3(0, 0, 0), vec3(4, 1, 1), 8, 2, 2);
    double tetrahedra = continuous_tip(cg_tetrahedra(&k));
    family first, last;
    memset(&first, 0, sizeof first);
    memset(&last, 0, sizeof last);
    paper_table(out, "192 tetrahedra, p = 1, BZ with the paper's scalar penalty, as eta varies",
                "eta|tip|tip / CG tip|tip / rigid cells' tip|jump (rms) / tip|energy in elements");
    for (int i = -8; i <= 10; i++) {
        double eta = pow(10, 0.5 * i);
        family f = solve(&k, eta);
        paper_row(out, "%.3g|%.5g|%.5f|%.5f|%.2e|%.2f %%", eta, f.tip, f.tip / tetrahedra, f.tip / f.rigid,
                  f.jump / fabs(f.tip), 100 * f.share);
        if (i == -8) first = f;
        last = f;
    }
    paper_print(out);
    kuhn_free(&k);
    paper_table(out, "The same bar: continuous elements and IP with the default penalty", "method|tip");
    paper_row(out, "CG linear, 192 tetrahedra|%.4f", tetrahedra);
    paper_row(out, "CG trilinear, 8 x 2 x 2 boxes|%.4f",
              continuous_tip(cg_boxes(vec3(0, 0, 0), vec3(4, 1, 1), 8, 2, 2)));
    paper_row(out, "CG trilinear, 32 x 8 x 8 boxes|%.4f",
              continuous_tip(cg_boxes(vec3(0, 0, 0), vec3(4, 1, 1), 32, 8, 8)));
    for (int degree = 1; degree <= 3; degree++)
        paper_row(out, "IP p=%d, 8 x 2 x 2 boxes|%.4f", degree, default_tip(boxes(2), degree));
    double reference = default_tip(boxes(out->quick ? 3 : 4), 3);
    paper_row(out, "reference: IP p=3, finer boxes|%.4f", reference);
    paper_print(out);
    paper_table(out, "Fig. 3 row by row", "quantity|ours|paper|expected");
    paper_row(out, "tip / CG tip, eta = 1e5|%.5f|approximates CG|1", last.tip / tetrahedra);
    paper_row(out, "jump / tip, eta = 1e5|%.1e|-|0", last.jump / fabs(last.tip));
    paper_row(out, "tip / rigid cells' tip, eta = 1e-4|%.5f|reproduces PriMo|1", first.tip / first.rigid);
    paper_row(out, "energy in elements, eta = 1e-4|%.2f %%|all in the glue|0", 100 * first.share);
    paper_row(out, "converged tip|%.4f|-|-0.399", reference);
    paper_row(out, "IP p=1, 8 x 2 x 2 boxes, default penalty|%.4f|-|-0.402", default_tip(boxes(2), 1));
    paper_print(out);
    paper_end(out);
    return 0;
}
