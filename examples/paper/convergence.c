/* Convergence to a manufactured solution: L2 errors and rates on cubes, on tetrahedra, and on cubes cut by random
   planes.

   Without body force, every harmonic phi gives an equilibrium displacement (Papkovich and Neuber, B = phi (1, 1, 1)):

     u = (3 - 4 nu) phi (1, 1, 1) - (x + y + z) grad phi,   div u = (2 - 4 nu) (d/dx + d/dy + d/dz) phi

   phi = exp(a x) sin(b y + 0.3) sin(c z + 0.2), a^2 = b^2 + c^2. u is prescribed on the whole boundary of the unit
   cube; the library fits it on each face by a polynomial of the element's degree. Smooth solutions converge with h^(p +
   1). */
#include "paper.h"

static const double a = 1.5, b = 1.2, c = 0.9, amplitude = 0.2;

static dgfem_vec3 exact(double poisson, dgfem_vec3 x) {
    double e = amplitude * exp(a * x.x), sy = sin(b * x.y + 0.3), sz = sin(c * x.z + 0.2);
    double phi = (3 - 4 * poisson) * e * sy * sz, s = x.x + x.y + x.z;
    return vec3(phi - s * a * e * sy * sz, phi - s * b * e * cos(b * x.y + 0.3) * sz,
                phi - s * c * e * sy * cos(c * x.z + 0.2));
}

static void prescribe(void *user, dgfem_vec3 rest, dgfem_vec3 *displacement) {
    *displacement = exact(*(const double *)user, rest);
}

/* ---- meshes ---- */

static dgfem_mesh *cubes(int n, int sample) { return (void)sample, grid_mesh(vec3(0, 0, 0), vec3(1, 1, 1), n, n, n); }

static dgfem_mesh *tetrahedra(int n, int sample) {
    (void)sample;
    kuhn k = kuhn_create(vec3(0, 0, 0), vec3(1, 1, 1), n, n, n);
    dgfem_mesh *mesh = kuhn_mesh(&k);
    kuhn_free(&k);
    return mesh;
}

typedef struct family {
    const char *name;
    dgfem_mesh *(*make)(int n, int sample);
    int samples;      /* random meshes of each size; their errors are averaged (geometric mean) */
    int levels[4][4]; /* of degree p: cells along each side, ends with 0 */
} family;

/* ---- one solve ---- */

typedef struct difference {
    const dgfem_body *body;
    int element;
    double poisson, sum;
} difference;

static void add_square(void *user, dgfem_vec3 x, double weight) {
    difference *d = (difference *)user;
    dgfem_vec3 u = dgfem_body_displacement(d->body, d->element, x), v = exact(d->poisson, x);
    d->sum += weight * ((u.x - v.x) * (u.x - v.x) + (u.y - v.y) * (u.y - v.y) + (u.z - v.z) * (u.z - v.z));
}

static double error_of(const dgfem_body *body, double poisson, int degree) {
    difference d;
    d.body = body, d.poisson = poisson, d.sum = 0;
    for (d.element = 0; d.element < body->mesh->element_count; d.element++) {
        dgfem_polyhedron *p;
        need(dgfem_mesh_element_polyhedron(body->mesh, d.element, &p), "element");
        quadrature_polyhedron(p, degree + 3, add_square, &d);
        dgfem_polyhedron_destroy(p);
    }
    return sqrt(d.sum);
}

typedef struct result {
    int elements, dofs, definite;
    double error, volumes; /* smallest / largest element */
} result;

/* eta 0: the default. */
static result solve(dgfem_mesh *mesh, int degree, dgfem_flux flux, double eta, double poisson) {
    dgfem_body_desc desc = linear_desc(1, poisson);
    result r;
    int count = 0, *faces = (int *)need_memory((size_t)mesh->face_count, sizeof *faces);
    for (int f = 0; f < mesh->face_count; f++)
        if (mesh->faces[f].element[1] == DGFEM_NONE) faces[count++] = f;
    desc.degree = degree, desc.flux = flux;
    if (eta > 0) desc.eta = eta;
    dgfem_body *body = body_of(desc, mesh);
    need(dgfem_body_fix_faces_fn(body, faces, count, prescribe, &poisson, NULL), "fix_faces_fn");
    r.definite = solve_linear(body, NULL);
    r.elements = mesh->element_count, r.dofs = 3 * body->basis_count;
    r.volumes = volume_ratio(mesh);
    r.error = r.definite ? error_of(body, poisson, degree) : (double)NAN;
    dgfem_body_destroy(body);
    free(faces);
    return r;
}

/* All samples of one mesh size. */
static result solve_samples(const family *f, int n, int degree, dgfem_flux flux, double eta, double poisson) {
    result r = solve(f->make(n, 0), degree, flux, eta, poisson);
    double logarithm = log(r.error);
    for (int sample = 1; sample < f->samples; sample++) {
        result next = solve(f->make(n, sample), degree, flux, eta, poisson);
        logarithm += log(next.error);
        r.elements += next.elements, r.dofs += next.dofs;
        if (next.volumes < r.volumes) r.volumes = next.volumes;
    }
    r.elements /= f->samples, r.dofs /= f->samples;
    r.error = exp(logarithm / f->samples);
    return r;
}

/* Rows of one family and degree; returns the rate of the finest pair of n; *finest becomes the last error. */
static double print_levels(paper *out, const family *f, int degree, dgfem_flux flux, double eta, double poisson,
                           double *finest) {
    result last;
    double rate = 0;
    memset(&last, 0, sizeof last);
    for (int l = 0; l < 4 && f->levels[degree][l]; l++) {
        if (out->quick && l > 0 && !f->levels[degree][l + 1]) break;
        int n = f->levels[degree][l];
        result r = solve_samples(f, n, degree, flux, eta, poisson);
        if (l) rate = paper_rate(last.error, r.error, (double)n / f->levels[degree][l - 1]);
        char text[16];
        snprintf(text, sizeof text, l ? "%.2f" : "-", rate);
        paper_row(out, "%s|%d|%d|%d|%d|%.0e|%.3e|%s", f->name, degree, n, r.elements, r.dofs, r.volumes, r.error, text);
        last = r;
    }
    *finest = last.error;
    return rate;
}

int main(int argc, char **argv) {
    static const family families[3] = {{"cubes", cubes, 1, {{0}, {4, 8, 16, 0}, {2, 4, 8, 0}, {2, 4, 6, 0}}},
                                       {"tetrahedra", tetrahedra, 1, {{0}, {2, 4, 8, 0}, {2, 4, 6, 0}, {1, 2, 4, 0}}},
                                       {"cut cubes", cut_cubes, 3, {{0}, {3, 6, 12, 0}, {2, 4, 8, 0}, {2, 3, 6, 0}}}};
    static const char *const columns = "mesh|p|n|elements|unknowns|Vmin/Vmax|L2 error|rate";
    program options = program_begin(argc, argv, "convergence [--csv FILE] [--markdown] [--quick]");
    paper *out = paper_begin(&options);
    double rates[3][4], hard[4], bz[2][4], error[4], bz_error[2][4], unused;
    for (int k = 0; k < 3; k++) {
        char title[80];
        snprintf(title, sizeof title, "IP with the default penalty, nu = 0.3: %s", families[k].name);
        paper_table(out, title, columns);
        for (int degree = 1; degree <= 3; degree++)
            rates[k][degree] =
                print_levels(out, &families[k], degree, DGFEM_FLUX_IP, 0, 0.3, k ? &unused : &error[degree]);
        paper_print(out);
    }
    paper_table(out, "IP with the default penalty, nearly incompressible, nu = 0.499: cubes", columns);
    for (int degree = 1; degree <= 3; degree++)
        hard[degree] = print_levels(out, &families[0], degree, DGFEM_FLUX_IP, 0, 0.499, &unused);
    paper_print(out);
    for (int k = 0; k < 2; k++) {
        char title[80];
        snprintf(title, sizeof title, "BZ, eta = %d, nu = 0.3: cubes", k ? 2 : 20);
        paper_table(out, title, columns);
        for (int degree = 1; degree <= 3; degree++)
            bz[k][degree] =
                print_levels(out, &families[0], degree, DGFEM_FLUX_BZ, k ? 2 : 20, 0.3, &bz_error[k][degree]);
        paper_print(out);
    }
    paper_table(out, "Rates of the finest pair, row by row", "quantity|p=1|p=2|p=3|expected");
    for (int k = 0; k < 3; k++)
        paper_row(out, "IP on %s|%.2f|%.2f|%.2f|p + 1; at least p + 0.85", families[k].name, rates[k][1], rates[k][2],
                  rates[k][3]);
    paper_row(out, "IP on cubes, nu = 0.499|%.2f|%.2f|%.2f|p + 1", hard[1], hard[2], hard[3]);
    for (int k = 0; k < 2; k++)
        paper_row(out, "BZ on cubes, eta = %d|%.2f|%.2f|%.2f|towards 0: stalls", k ? 2 : 20, bz[k][1], bz[k][2],
                  bz[k][3]);
    for (int k = 0; k < 2; k++)
        paper_row(out, "BZ's error / IP's, finest cubes, eta = %d|%.1f|%.1f|%.1f|grows without bound", k ? 2 : 20,
                  bz_error[k][1] / error[1], bz_error[k][2] / error[2], bz_error[k][3] / error[3]);
    paper_print(out);
    paper_end(out);
    return 0;
}
