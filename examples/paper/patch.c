/* Patch test: a linear displacement, prescribed on the whole boundary of a cube of random polyhedra, must come out
   exactly, whatever the elements' shapes, degrees and penalties. The cube's 3^3 cells are cut by three random planes;
   nothing is snapped, so that slivers come about. Of many such meshes those with Vmin/Vmax below 1e-6 are taken.

   Error: largest over all corners of all elements, slivers included, divided by the largest displacement. What is left
   is round-off, which grows with the condition number: monomials of the degrees 2 and 3 are nearly dependent on a flat,
   inclined element. BZ, which is not consistent, fails the test. */
#include "paper.h"

static void prescribe(void *user, dgfem_vec3 x, dgfem_vec3 *u) {
    (void)user;
    *u = vec3(0.1 * x.x + 0.2 * x.y - 0.3 * x.z + 0.05, -0.4 * x.x + 0.5 * x.y + 0.6 * x.z - 1,
              0.7 * x.x - 0.8 * x.y + 0.9 * x.z + 0.2);
}

/* The largest error at the vertices of one element's faces; *largest is the largest displacement. */
static double element_error(const dgfem_body *body, int element, double *largest) {
    const dgfem_mesh *mesh = body->mesh;
    const dgfem_element *e = &mesh->elements[element];
    double error = 0;
    for (int i = e->face_start; i < e->face_start + e->face_count; i++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[i]];
        for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            for (int k = 0; k < mesh->loops[l].count; k++) {
                dgfem_vec3 x = mesh->vertices[mesh->loop_vertices[mesh->loops[l].start + k]], v;
                dgfem_vec3 u = dgfem_body_displacement(body, element, x);
                prescribe(NULL, x, &v);
                double d = sqrt((u.x - v.x) * (u.x - v.x) + (u.y - v.y) * (u.y - v.y) + (u.z - v.z) * (u.z - v.z));
                double size = sqrt(v.x * v.x + v.y * v.y + v.z * v.z);
                if (!(d <= error)) error = d;
                if (size > *largest) *largest = size;
            }
    }
    return error;
}

typedef struct result {
    int elements;
    double error, volumes; /* smallest / largest element */
} result;

/* degree 0: 1, 2 and 3 in turn. */
static result solve(int n, int sample, int degree, dgfem_flux flux, dgfem_penalty penalty) {
    dgfem_body_desc desc = linear_desc(1, 0.3);
    dgfem_mesh *mesh = cut_cubes(n, sample);
    int count = 0, *faces = (int *)need_memory((size_t)mesh->face_count, sizeof *faces);
    int *degrees = (int *)need_memory((size_t)mesh->element_count, sizeof *degrees);
    double largest = 0;
    result r;
    for (int f = 0; f < mesh->face_count; f++)
        if (mesh->faces[f].element[1] == DGFEM_NONE) faces[count++] = f;
    for (int e = 0; e < mesh->element_count; e++) degrees[e] = degree ? degree : 1 + e % 3;
    desc.degrees = degrees, desc.flux = flux, desc.penalty = penalty;
    if (flux == DGFEM_FLUX_BZ) desc.eta = 20;
    dgfem_body *body = body_of(desc, mesh);
    need(dgfem_body_fix_faces_fn(body, faces, count, prescribe, NULL, NULL), "fix_faces_fn");
    if (!solve_linear(body, NULL)) need(DGFEM_ERROR_NOT_POSITIVE_DEFINITE, "patch test");
    r.elements = mesh->element_count;
    r.volumes = volume_ratio(mesh);
    r.error = 0;
    for (int e = 0; e < mesh->element_count; e++) {
        double error = element_error(body, e, &largest);
        if (!(error <= r.error)) r.error = error;
    }
    r.error /= largest;
    dgfem_body_destroy(body);
    free(faces);
    free(degrees);
    return r;
}

enum { MOST = 60 };

typedef struct survey {
    double errors[MOST];
    int count, good; /* good: below 1e-13 */
} survey;

static void add(survey *s, double error) {
    s->errors[s->count++] = error;
    if (error < 1e-13) s->good++;
}

int main(int argc, char **argv) {
    static const char *const names[4] = {"mixed degrees", "p=1", "p=2", "p=3"};
    static const char *const penalties[3] = {"split (default)", "tensor", "scalar"};
    program options = program_begin(argc, argv, "patch [--csv FILE] [--markdown] [--quick]");
    paper *out = paper_begin(&options);
    int samples = out->quick ? 10 : MOST, first = DGFEM_NONE;
    double thinnest = 1, fattest = 0, bz = HUGE_VAL;
    survey surveys[4];
    memset(surveys, 0, sizeof surveys);
    paper_table(out, "Patch test on random polyhedra: largest error",
                "planes|elements|Vmin/Vmax|p=1|p=2|p=3|mixed degrees");
    for (int s = 0; s < samples; s++) {
        result r[4];
        dgfem_mesh *mesh = cut_cubes(3, s);
        double volumes = volume_ratio(mesh);
        dgfem_mesh_destroy(mesh);
        if (volumes > 1e-6) continue;
        for (int degree = 0; degree <= 3; degree++) {
            r[degree] = solve(3, s, degree, DGFEM_FLUX_IP, DGFEM_PENALTY_SPLIT);
            add(&surveys[degree], r[degree].error);
        }
        if (first == DGFEM_NONE) first = s;
        if (volumes < thinnest) thinnest = volumes;
        if (volumes > fattest) fattest = volumes;
        paper_row(out, "%d|%d|%.1e|%.1e|%.1e|%.1e|%.1e", s, r[1].elements, volumes, r[1].error, r[2].error, r[3].error,
                  r[0].error);
    }
    paper_print(out);
    paper_table(out, "The first mesh with the other penalties, and with BZ", "penalty|p=1|p=2|p=3|mixed degrees");
    for (int k = 0; k <= 3; k++) {
        double e[4];
        for (int degree = 0; degree <= 3; degree++) {
            e[degree] = k < 3 ? solve(3, first, degree, DGFEM_FLUX_IP, (dgfem_penalty)k).error
                              : solve(3, first, degree, DGFEM_FLUX_BZ, DGFEM_PENALTY_SPLIT).error;
            if (k == 3 && e[degree] < bz) bz = e[degree];
        }
        paper_row(out, "%s|%.1e|%.1e|%.1e|%.1e", k < 3 ? penalties[k] : "BZ, eta = 20", e[1], e[2], e[3], e[0]);
    }
    paper_print(out);
    paper_table(out, "Patch test row by row",
                "degrees|meshes|Vmin/Vmax|below 1e-13|least error|median|largest|expected");
    for (int k = 1; k <= 4; k++) {
        survey *s = &surveys[k % 4];
        qsort(s->errors, (size_t)s->count, sizeof(double), compare_reals);
        paper_row(out, "%s|%d|%.0e .. %.0e|%d|%.1e|%.1e|%.1e|1e-13", names[k % 4], s->count, thinnest, fattest, s->good,
                  s->errors[0], s->errors[s->count / 2], s->errors[s->count - 1]);
    }
    paper_row(out, "BZ|1|-|0|%.0e|-|-|not small", bz);
    paper_print(out);
    paper_end(out);
    return 0;
}
