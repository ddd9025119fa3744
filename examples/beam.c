/* A box of hexahedra, clamped at x = 0, bends under gravity along -z: statically or in time. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "formats.h"
#include "program.h"

typedef struct beam {
    int cells[3];
    double size[3];
    double gravity, dt;
    int is_static, steps;
    const char *vtu;
    dgfem_body_desc desc;
} beam;

static beam read_options(int argc, char **argv) {
    program p = program_begin(argc, argv,
                              "beam [--nx 8] [--ny 2] [--nz 2] [--lx 4] [--ly 1] [--lz 1] [--degree 1..3]\n"
                              "  [--flux ip|bz] [--penalty split|tensor|scalar] [--eta E]\n"
                              "  [--young 2.5e6] [--poisson 0.3] [--density 1000] [--gravity 9.81] [--warp 0|1]\n"
                              "  [--static | --steps N --dt 0.0166] [--solver auto|stale|cholesky|sweeps|pcg] [--vtu FILE]");
    static const dgfem_flux fluxes[] = {DGFEM_FLUX_IP, DGFEM_FLUX_BZ};
    static const dgfem_penalty penalties[] = {DGFEM_PENALTY_SPLIT, DGFEM_PENALTY_TENSOR, DGFEM_PENALTY_SCALAR};
    beam b;
    b.desc = dgfem_default_body_desc();
    b.cells[0] = program_int(&p, "--nx", 8, 1, 1000);
    b.cells[1] = program_int(&p, "--ny", 2, 1, 1000);
    b.cells[2] = program_int(&p, "--nz", 2, 1, 1000);
    b.size[0] = program_real(&p, "--lx", 4);
    b.size[1] = program_real(&p, "--ly", 1);
    b.size[2] = program_real(&p, "--lz", 1);
    b.desc.degree = program_int(&p, "--degree", 1, 1, DGFEM_MAX_DEGREE);
    b.desc.flux = fluxes[program_choice(&p, "--flux", "ip|bz", 0)];
    b.desc.penalty = penalties[program_choice(&p, "--penalty", "split|tensor|scalar", 0)];
    b.desc.eta = (dgfem_real)program_real(&p, "--eta", b.desc.flux == DGFEM_FLUX_BZ ? 20 : 4);
    b.desc.material.young = (dgfem_real)program_real(&p, "--young", 2.5e6);
    b.desc.material.poisson = (dgfem_real)program_real(&p, "--poisson", 0.3);
    b.desc.material.density = (dgfem_real)program_real(&p, "--density", 1000);
    b.gravity = program_real(&p, "--gravity", 9.81);
    b.desc.warp = program_int(&p, "--warp", 1, 0, 1);
    b.is_static = program_flag(&p, "--static");
    b.steps = program_int(&p, "--steps", 0, 0, INT_MAX);
    b.dt = program_real(&p, "--dt", 1.0 / 60);
    b.desc.solver = (dgfem_solver)program_choice(&p, "--solver", "auto|stale|cholesky|sweeps|pcg", 0);
    b.vtu = program_text(&p, "--vtu", NULL);
    program_end(&p);
    if (b.steps == 0) b.is_static = 1;
    if (b.is_static) b.desc.solver_tolerance = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-6) : DGFEM_R(1e-11);
    b.desc.gravity.z = (dgfem_real)-b.gravity;
    b.desc.hooks = program_hooks();
    return b;
}

static dgfem_plane plane_x(double offset) {
    dgfem_plane plane = {{1, 0, 0}, 0};
    plane.offset = (dgfem_real)offset;
    return plane;
}

/* Boundary faces at this x; their number is *count. To be freed. */
static int *faces_at(const dgfem_mesh *mesh, double x, double tolerance, int *count) {
    int room = dgfem_mesh_faces_on_plane(mesh, plane_x(x), (dgfem_real)tolerance, NULL, 0);
    int *faces = (int *)malloc((size_t)(room + 1) * sizeof *faces);
    *count = faces ? dgfem_mesh_faces_on_plane(mesh, plane_x(x), (dgfem_real)tolerance, faces, room) : 0;
    return faces;
}

static dgfem_body *make_body(beam *b) {
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    dgfem_vec3 zero = {0, 0, 0};
    dgfem_body *body;
    int count;
    for (int axis = 0; axis < 3; axis++) grid.cells[axis] = b->cells[axis];
    grid.upper.x = (dgfem_real)b->size[0], grid.upper.y = (dgfem_real)b->size[1], grid.upper.z = (dgfem_real)b->size[2];
    grid.hooks = b->desc.hooks;
    if (dgfem_mesh_create_grid(&grid, &b->desc.mesh)) return NULL;
    if (dgfem_body_create(&b->desc, &body)) {
        dgfem_mesh_destroy(b->desc.mesh);
        return NULL;
    }
    int *held = faces_at(body->mesh, 0, 1e-6 * b->size[0], &count);
    dgfem_status status = held ? dgfem_body_fix_faces(body, held, count, zero, NULL) : DGFEM_ERROR_MEMORY;
    free(held);
    if (!status) return body;
    dgfem_body_destroy(body);
    return NULL;
}

/* Statically, or `steps` steps of time; the figures of all steps are added up. */
static dgfem_status run(const beam *b, dgfem_body *body, dgfem_step_info *total) {
    dgfem_static_desc solve = dgfem_default_static_desc();
    dgfem_status status = DGFEM_OK;
    memset(total, 0, sizeof *total);
    if (b->is_static) return dgfem_body_solve_static(body, &solve, total);
    for (int step = 0; !status && step < b->steps; step++) {
        dgfem_step_info info;
        status = dgfem_body_step(body, (dgfem_real)b->dt, &info);
        total->iterations += info.iterations;
        total->seconds_assemble += info.seconds_assemble;
        total->seconds_factor += info.seconds_factor;
        total->seconds_solve += info.seconds_solve;
    }
    return status;
}

static void print_tip(const beam *b, const dgfem_body *body) {
    static const char *const names[3] = {"tip_x", "tip_y", "tip_z"};
    double sum[3] = {0, 0, 0}, area = 0;
    int count, *faces = faces_at(body->mesh, b->size[0], 1e-6 * b->size[0], &count);
    for (int i = 0; i < count; i++) {
        double a = (double)body->mesh->faces[faces[i]].area;
        dgfem_vec3 u = dgfem_body_face_displacement(body, faces[i]);
        sum[0] += a * (double)u.x, sum[1] += a * (double)u.y, sum[2] += a * (double)u.z;
        area += a;
    }
    free(faces);
    for (int axis = 0; axis < 3; axis++) printf("%s %.10g\n", names[axis], sum[axis] / area);
}

static dgfem_vec3 deformed(void *user, int element, int vertex) {
    const dgfem_body *body = (const dgfem_body *)user;
    dgfem_vec3 x = body->mesh->vertices[vertex], u = dgfem_body_displacement(body, element, x);
    x.x += u.x, x.y += u.y, x.z += u.z;
    return x;
}

static int write_vtu(const char *path, dgfem_body *body) {
    size_t n = (size_t)body->mesh->element_count;
    double *stress = (double *)malloc(9 * n * sizeof *stress);
    formats_cell_data data;
    formats_error error;
    if (!stress) return 0;
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfem_mat3 s = dgfem_body_stress(body, e, body->mesh->elements[e].centre);
        for (int k = 0; k < 9; k++) stress[9 * e + k] = (double)s.m[k / 3][k % 3];
    }
    data.name = "stress", data.components = 9, data.values = stress;
    int ok = formats_write_vtu(path, body->mesh, deformed, body, &data, 1, &error);
    if (!ok) fprintf(stderr, "%s\n", error.text);
    free(stress);
    return ok;
}

int main(int argc, char **argv) {
    beam b = read_options(argc, argv);
    dgfem_step_info info;
    dgfem_energy energy;
    dgfem_body *body = make_body(&b);
    if (!body) return 1;
    dgfem_status status = run(&b, body, &info);
    if (!status) status = dgfem_body_energy(body, &energy);
    if (!status) {
        printf("elements %d\ndofs %d\n", body->mesh->element_count, 3 * body->basis_count);
        print_tip(&b, body);
        printf("energy %.10g\niterations %d\nsweeps %d\n", (double)energy.elastic, info.iterations, info.sweeps);
        printf("milliseconds_assemble %.3f\n", 1e3 * info.seconds_assemble);
        printf("milliseconds_solve %.3f\n", 1e3 * (info.seconds_factor + info.seconds_solve));
        if (b.vtu && !write_vtu(b.vtu, body)) status = DGFEM_ERROR_ARGUMENT;
    }
    dgfem_body_destroy(body);
    return status ? 1 : 0;
}
