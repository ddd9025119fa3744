/* Free spin: a bar of 1 x 0.5 x 0.5 turns about the z axis at 3 rad/s for 3 s (1.4 turns), drifting at 1 m/s, with
   nothing acting on it; stiffness warping, semi-implicit Euler. Density 1000, nu = 0.3.

   Linear momentum is kept by the scheme, so only the solver's round-off is left. Angular momentum is kept where strains
   are small: the step's forces are those of the rotations at its start, which exert no torque on the start's positions.
   The price is that a step turns the body by h w along the tangent, which lengthens it by (h w)^2 / 2; it then turns in
   this stretched state. Starting without strain, the energy jumps once, in the first step, by about
   E (h w)^4 / (rho w^2 r^2): much for a stiff body and a large step. Later steps should not let it grow.

     drift   largest change of the linear momentum / the momentum itself
     loss    of angular momentum at the end
     growth  largest increase of the energy, kinetic and elastic, in one step / largest energy so far */
#include "paper.h"

typedef struct result {
    double drift, loss, first, growth, energy; /* growth in the first step and later; energy: last / first */
} result;

static double length(dgfem_vec3 a) { return sqrt(a.x * a.x + a.y * a.y + a.z * a.z); }

static dgfem_body *bar(double young, int degree, int tetrahedra) {
    dgfem_body_desc desc = linear_desc(young, 0.3);
    dgfem_vec3 lower = vec3(-0.5, -0.25, -0.25), upper = vec3(0.5, 0.25, 0.25);
    dgfem_mat3 spin = {{{0, -3, 0}, {3, 0, 0}, {0, 0, 0}}};
    dgfem_body *body;
    desc.material.density = 1000;
    desc.degree = degree, desc.warp = 1;
    if (tetrahedra) {
        kuhn k = kuhn_create(lower, upper, 2, 1, 1);
        body = body_of(desc, kuhn_mesh(&k));
        kuhn_free(&k);
    } else {
        body = body_of(desc, grid_mesh(lower, upper, 4, 2, 2));
    }
    need(dgfem_body_set_affine_velocity(body, spin, vec3(0.6, 0, 0.8)), "velocity");
    return body;
}

/* The angular momentum about the centre of mass. */
static dgfem_vec3 intrinsic(const dgfem_body *body, dgfem_vec3 *linear) {
    dgfem_vec3 p, l, c = vec3(0, 0, 0);
    double mass = dgfem_body_mass(body);
    need(dgfem_body_momentum(body, &p, &l), "momentum");
    c.x = p.x / mass * body->time, c.y = p.y / mass * body->time, c.z = p.z / mass * body->time;
    *linear = p;
    return vec3(l.x - c.y * p.z + c.z * p.y, l.y - c.z * p.x + c.x * p.z, l.z - c.x * p.y + c.y * p.x);
}

static double energy_of(const dgfem_body *body) {
    dgfem_energy e;
    need(dgfem_body_energy(body, &e), "energy");
    return e.kinetic + e.elastic;
}

static result spin(double young, int degree, int tetrahedra, int steps_per_second) {
    dgfem_body *body = bar(young, degree, tetrahedra);
    dgfem_vec3 p0, p, l0 = intrinsic(body, &p0), l = l0;
    double first = energy_of(body), last = first, largest = first;
    result r;
    r.drift = r.first = r.growth = 0;
    for (int step = 0; step < 3 * steps_per_second; step++) {
        need(dgfem_body_step(body, 1.0 / steps_per_second, NULL), "step");
        l = intrinsic(body, &p);
        double drift = length(vec3(p.x - p0.x, p.y - p0.y, p.z - p0.z)) / length(p0), energy = energy_of(body);
        if (!(drift <= r.drift)) r.drift = drift;
        if (energy > largest) largest = energy;
        if (!step) r.first = (energy - last) / largest;
        else if (!((energy - last) / largest <= r.growth)) r.growth = (energy - last) / largest;
        last = energy;
    }
    r.loss = 1 - length(l) / length(l0);
    r.energy = last / first;
    dgfem_body_destroy(body);
    return r;
}

static void take_worse(result *worst, const result *r) {
    if (!(r->drift <= worst->drift)) worst->drift = r->drift;
    if (!(fabs(r->loss) <= worst->loss)) worst->loss = fabs(r->loss);
    if (!(r->first <= worst->first)) worst->first = r->first;
    if (!(r->growth <= worst->growth)) worst->growth = r->growth;
}

int main(int argc, char **argv) {
    static const double youngs[5] = {1e3, 1e4, 1e5, 1e6, 1e7};
    static const char *const meshes[2] = {"16 boxes", "12 tetrahedra"};
    program options = program_begin(argc, argv, "spin [--csv FILE] [--markdown] [--quick]");
    paper *out = paper_begin(&options);
    result worst[2][5];
    memset(worst, 0, sizeof worst);
    for (int tetrahedra = 0; tetrahedra < 2; tetrahedra++) {
        char title[120];
        snprintf(title, sizeof title, "Free spin, 3 rad/s for 3 s, %s", meshes[tetrahedra]);
        paper_table(out, title,
                    "p|step|E, Pa|momentum drift|angular loss %|growth %, first step|growth %, later|energy left %");
        for (int degree = 1; degree <= (out->quick ? 2 : 3); degree++)
            for (int k = 0; k < 2; k++)
                for (int y = 0; y < 5; y++) {
                    int rate = k ? 30 : 60;
                    result r = spin(youngs[y], degree, tetrahedra, rate);
                    paper_row(out, "%d|1/%d|%.0e|%.1e|%.4f|%.4f|%.4f|%.3f", degree, rate, youngs[y], r.drift,
                              100 * r.loss, 100 * r.first, 100 * r.growth, 100 * r.energy);
                    take_worse(&worst[k][y], &r);
                }
        paper_print(out);
    }
    paper_table(out, "Free spin row by row: the worst of all degrees and meshes",
                "step, E|momentum drift|angular momentum|growth, first step|growth, later");
    for (int k = 0; k < 2; k++)
        for (int y = 0; y < 5; y++) {
            const result *w = &worst[k][y];
            paper_row(out, "h = 1/%d, E = %.0e|%.1e|%.3f %%|%.3f %%|%.3f %%", k ? 30 : 60, youngs[y], w->drift,
                      100 * w->loss, 100 * w->first, 100 * w->growth);
        }
    paper_row(out, "expected|the solver's accuracy|below 0.5 %%|below 1 %%|below 1 %%");
    paper_print(out);
    paper_end(out);
    return 0;
}
