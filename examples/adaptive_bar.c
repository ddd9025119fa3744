/* A bar of 36 hexahedra, held at x = 0, bends under its weight, while elements whose largest absolute principal stress
   exceeds a threshold are split into eight, or into two across that stress, or get a higher degree: the paper's Fig. 8. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "formats.h"
#include "program.h"

typedef struct bar {
    int cells[3];
    double size[3];
    int both_ends, is_static, rounds, every;
    double seconds, dt;
    const char *vtu;
    dgfem_body_desc desc;
    dgfem_refine_desc refine;
} bar;

static bar read_options(int argc, char **argv) {
    program p = program_begin(
        argc, argv,
        "adaptive_bar [--how eight|two|degree] [--above PA] [--below PA] [--smallest M]\n"
        "  [--nx 4] [--ny 3] [--nz 3] [--lx 4.5] [--ly 1] [--lz 1] [--both-ends] [--degree 1..3]\n"
        "  [--young 1e6] [--gravity 0.3] [--rounds 10 | --seconds S --dt 0.0333 [--every 1]] [--vtu FILE]\n"
        "  --rounds: static equilibrium before each; the last is the one that changes nothing");
    static const dgfem_refine_action hows[] = {DGFEM_REFINE_EIGHT, DGFEM_REFINE_TWO, DGFEM_REFINE_RAISE};
    bar b;
    b.desc = dgfem_default_body_desc();
    b.refine = dgfem_default_refine_desc();
    b.refine.how = hows[program_choice(&p, "--how", "eight|two|degree", 0)];
    b.refine.refine_above = (dgfem_real)program_real(&p, "--above", 6490);
    b.refine.merge_below = (dgfem_real)program_real(&p, "--below", 0);
    b.refine.smallest = (dgfem_real)program_real(&p, "--smallest", 0.12);
    b.cells[0] = program_int(&p, "--nx", 4, 1, 1000);
    b.cells[1] = program_int(&p, "--ny", 3, 1, 1000);
    b.cells[2] = program_int(&p, "--nz", 3, 1, 1000);
    b.size[0] = program_real(&p, "--lx", 4.5);
    b.size[1] = program_real(&p, "--ly", 1);
    b.size[2] = program_real(&p, "--lz", 1);
    b.both_ends = program_flag(&p, "--both-ends");
    b.desc.degree = program_int(&p, "--degree", 1, 1, DGFEM_MAX_DEGREE);
    b.desc.material.young = (dgfem_real)program_real(&p, "--young", 1e6);
    b.desc.gravity.z = (dgfem_real)-program_real(&p, "--gravity", 0.3);
    b.rounds = program_int(&p, "--rounds", 10, 0, 1000);
    b.seconds = program_real(&p, "--seconds", 0);
    b.is_static = !(b.seconds > 0);
    b.dt = program_real(&p, "--dt", 1.0 / 30);
    b.every = program_int(&p, "--every", 1, 1, 1000);
    b.vtu = program_text(&p, "--vtu", NULL);
    program_end(&p);
    b.desc.hooks = program_hooks();
    return b;
}

static dgfem_status hold_end(dgfem_body *body, double x) {
    dgfem_plane plane = {{1, 0, 0}, 0};
    dgfem_vec3 zero = {0, 0, 0};
    plane.offset = (dgfem_real)x;
    int room = body->mesh->face_count;
    int *faces = (int *)malloc((size_t)room * sizeof *faces);
    if (!faces) return DGFEM_ERROR_MEMORY;
    int count = dgfem_mesh_faces_on_plane(body->mesh, plane, DGFEM_R(1e-4), faces, room);
    dgfem_status status = dgfem_body_fix_faces(body, faces, count, zero, NULL);
    free(faces);
    return status;
}

static dgfem_body *make_body(bar *b) {
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    dgfem_body *body;
    for (int axis = 0; axis < 3; axis++) grid.cells[axis] = b->cells[axis];
    grid.upper.x = (dgfem_real)b->size[0], grid.upper.y = (dgfem_real)b->size[1], grid.upper.z = (dgfem_real)b->size[2];
    grid.hooks = b->desc.hooks;
    if (dgfem_mesh_create_grid(&grid, &b->desc.mesh)) return NULL;
    if (dgfem_body_create(&b->desc, &body)) {
        dgfem_mesh_destroy(b->desc.mesh);
        return NULL;
    }
    if (!hold_end(body, 0) && (!b->both_ends || !hold_end(body, b->size[0]))) return body;
    dgfem_body_destroy(body);
    return NULL;
}

/* Prints a line whenever elements or degrees have changed; *changes counts what has. */
static dgfem_status refine(const bar *b, dgfem_body *body, const char *unit, double when, int *changes) {
    dgfem_refine_info info;
    dgfem_status status = dgfem_body_refine(body, &b->refine, &info);
    if (status) return status;
    *changes = info.elements_split + info.elements_merged + info.degrees_raised + info.degrees_lowered;
    if (*changes > 0)
        printf("%s %.4g elements %d dofs %d split %d merged %d stress %.4g\n", unit, when, body->mesh->element_count,
               3 * body->basis_count, info.elements_split, info.elements_merged, (double)info.largest_stress);
    return DGFEM_OK;
}

static dgfem_status run_static(const bar *b, dgfem_body *body) {
    dgfem_static_desc solve = dgfem_default_static_desc();
    dgfem_status status = dgfem_body_solve_static(body, &solve, NULL);
    int changes = 1;
    for (int round = 1; !status && changes > 0 && round <= b->rounds; round++) {
        status = refine(b, body, "round", round, &changes);
        if (!status && changes > 0) status = dgfem_body_solve_static(body, &solve, NULL);
    }
    return status;
}

static dgfem_status run_in_time(const bar *b, dgfem_body *body) {
    dgfem_status status = DGFEM_OK;
    int steps = (int)(b->seconds / b->dt + 0.5), changes;
    for (int step = 1; !status && step <= steps; step++) {
        status = dgfem_body_step(body, (dgfem_real)b->dt, NULL);
        if (!status && step % b->every == 0) status = refine(b, body, "second", body->time, &changes);
    }
    return status;
}

static dgfem_vec3 deformed(void *user, int element, int vertex) {
    const dgfem_body *body = (const dgfem_body *)user;
    dgfem_vec3 x = body->mesh->vertices[vertex], u = dgfem_body_displacement(body, element, x);
    x.x += u.x, x.y += u.y, x.z += u.z;
    return x;
}

static double stress_of(const dgfem_body *body, int element) {
    dgfem_real values[3];
    dgfem_body_mean_principal_stress(body, element, values, NULL);
    return fmax(fabs((double)values[0]), fabs((double)values[2]));
}

static int write_vtu(const char *path, dgfem_body *body) {
    size_t n = (size_t)body->mesh->element_count;
    double *stress = (double *)malloc(n * sizeof *stress), *degree = (double *)malloc(n * sizeof *degree);
    formats_cell_data data[2];
    formats_error error;
    int ok = stress && degree;
    for (int e = 0; ok && e < body->mesh->element_count; e++)
        stress[e] = stress_of(body, e), degree[e] = body->degree[e];
    data[0].name = "stress", data[0].components = 1, data[0].values = stress;
    data[1].name = "degree", data[1].components = 1, data[1].values = degree;
    if (ok && !formats_write_vtu(path, body->mesh, deformed, body, data, 2, &error))
        ok = 0, fprintf(stderr, "%s\n", error.text);
    free(stress);
    free(degree);
    return ok;
}

int main(int argc, char **argv) {
    bar b = read_options(argc, argv);
    dgfem_body *body = make_body(&b);
    if (!body) return 1;
    dgfem_status status = b.is_static ? run_static(&b, body) : run_in_time(&b, body);
    if (!status) {
        double largest = 0;
        for (int e = 0; e < body->mesh->element_count; e++) largest = fmax(largest, stress_of(body, e));
        printf("elements %d\ndofs %d\nlargest_stress %.6g\nvolume %.15g\n", body->mesh->element_count,
               3 * body->basis_count, largest, (double)dgfem_mesh_volume(body->mesh));
        if (b.vtu && !write_vtu(b.vtu, body)) status = DGFEM_ERROR_ARGUMENT;
    }
    dgfem_body_destroy(body);
    return status ? 1 : 0;
}
