/* A bar is pulled at both ends until it tears: glue between elements breaks where the traction exceeds their strength,
   which varies a little from element to element, and with --split elements break inside as well. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "formats.h"
#include "program.h"

typedef struct tear {
    int cells[3];
    double size[3];
    double strain, seconds, dt; /* the ends part by strain * length within this time */
    double strength, scatter;   /* Pa, and how much of it elements may lack */
    const char *vtu, *obj;
    dgfem_body_desc desc;
    dgfem_fracture_desc fracture;
} tear;

static tear read_options(int argc, char **argv) {
    program p =
        program_begin(argc, argv,
                      "fracture [--nx 16] [--ny 4] [--nz 4] [--lx 4] [--ly 1] [--lz 1] [--degree 1..3]\n"
                      "  [--young 1e6] [--strain 0.3] [--seconds 1] [--dt 0.0033]\n"
                      "  [--strength 1e5] [--scatter 0.3] [--toughness 0] [--max-breaks N] [--split] [--smallest 0.1]\n"
                      "  [--vtu FILE] [--obj FILE]");
    tear t;
    t.desc = dgfem_default_body_desc();
    t.fracture = dgfem_default_fracture_desc();
    t.cells[0] = program_int(&p, "--nx", 16, 1, 1000);
    t.cells[1] = program_int(&p, "--ny", 4, 1, 1000);
    t.cells[2] = program_int(&p, "--nz", 4, 1, 1000);
    t.size[0] = program_real(&p, "--lx", 4);
    t.size[1] = program_real(&p, "--ly", 1);
    t.size[2] = program_real(&p, "--lz", 1);
    t.desc.degree = program_int(&p, "--degree", 1, 1, DGFEM_MAX_DEGREE);
    t.desc.material.young = (dgfem_real)program_real(&p, "--young", 1e6);
    t.strain = program_real(&p, "--strain", 0.3);
    t.seconds = program_real(&p, "--seconds", 1);
    t.dt = program_real(&p, "--dt", 1.0 / 300);
    t.strength = program_real(&p, "--strength", 1e5);
    t.scatter = program_real(&p, "--scatter", 0.3);
    t.fracture.toughness = (dgfem_real)program_real(&p, "--toughness", 0);
    t.fracture.max_breaks = program_int(&p, "--max-breaks", INT_MAX, 0, INT_MAX);
    t.fracture.split = program_flag(&p, "--split");
    t.fracture.smallest = (dgfem_real)program_real(&p, "--smallest", 0.1);
    t.vtu = program_text(&p, "--vtu", NULL);
    t.obj = program_text(&p, "--obj", NULL);
    program_end(&p);
    t.desc.gravity.z = 0;
    t.desc.damping_stiffness = DGFEM_R(0.002);
    t.desc.hooks = program_hooks();
    return t;
}

/* Holds the faces of one end; *id moves them. */
static dgfem_status hold_end(dgfem_body *body, double x, int *id) {
    dgfem_plane plane = {{1, 0, 0}, 0};
    dgfem_vec3 zero = {0, 0, 0};
    plane.offset = (dgfem_real)x;
    int room = body->mesh->face_count;
    int *faces = (int *)malloc((size_t)room * sizeof *faces);
    if (!faces) return DGFEM_ERROR_MEMORY;
    int count = dgfem_mesh_faces_on_plane(body->mesh, plane, DGFEM_R(1e-4), faces, room);
    dgfem_status status = dgfem_body_fix_faces(body, faces, count, zero, id);
    free(faces);
    return status;
}

static dgfem_body *make_body(tear *t, int ends[2]) {
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    dgfem_body *body;
    for (int axis = 0; axis < 3; axis++) grid.cells[axis] = t->cells[axis];
    grid.upper.x = (dgfem_real)t->size[0], grid.upper.y = (dgfem_real)t->size[1], grid.upper.z = (dgfem_real)t->size[2];
    grid.hooks = t->desc.hooks;
    if (dgfem_mesh_create_grid(&grid, &t->desc.mesh)) return NULL;
    if (dgfem_body_create(&t->desc, &body)) {
        dgfem_mesh_destroy(t->desc.mesh);
        return NULL;
    }
    if (!hold_end(body, 0, &ends[0]) && !hold_end(body, t->size[0], &ends[1])) return body;
    dgfem_body_destroy(body);
    return NULL;
}

/* A number in [0, 1) that belongs to a grid cell: elements keep its index as their tag when they are split. */
static double noise(int tag) {
    unsigned long long z = (unsigned long long)tag * 0x9e3779b97f4a7c15ull + 0x632be59bd9b4e019ull;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
    return (double)((z ^ (z >> 31)) >> 11) / 9007199254740992.0;
}

static dgfem_status break_glue(const tear *t, dgfem_body *body, dgfem_fracture_info *info) {
    dgfem_fracture_desc desc = t->fracture;
    int n = body->mesh->element_count;
    dgfem_real *strengths = (dgfem_real *)malloc((size_t)n * sizeof *strengths);
    if (!strengths) return DGFEM_ERROR_MEMORY;
    for (int e = 0; e < n; e++)
        strengths[e] = (dgfem_real)(t->strength * (1 - t->scatter * noise(body->mesh->elements[e].tag)));
    desc.strengths = strengths;
    dgfem_status status = dgfem_body_fracture(body, &desc, info);
    free(strengths);
    return status;
}

/* Pulls, and breaks after every step. Stops a little after the bar has come apart. */
static dgfem_status run(const tear *t, dgfem_body *body, const int ends[2], dgfem_fracture_info *total) {
    dgfem_fracture_info info;
    dgfem_status status = DGFEM_OK;
    int steps = (int)(t->seconds / t->dt + 0.5), pieces = 1, after = 0;
    memset(total, 0, sizeof *total);
    for (int step = 1; !status && step <= steps; step++) {
        dgfem_vec3 u = {0, 0, 0};
        u.x = (dgfem_real)(t->strain * t->size[0] / 2 * step / steps);
        status = dgfem_body_move_fixture(body, ends[1], u);
        u.x = -u.x;
        if (!status) status = dgfem_body_move_fixture(body, ends[0], u);
        if (!status) status = dgfem_body_step(body, (dgfem_real)t->dt, NULL);
        if (!status) status = break_glue(t, body, &info);
        if (status) break;
        if (total->faces_broken == 0 && info.faces_broken > 0) printf("first_break_s %.4f\n", body->time);
        total->faces_broken += info.faces_broken;
        total->elements_split += info.elements_split;
        int last = pieces;
        status = dgfem_body_pieces(body, NULL, NULL, 0, &pieces);
        if (last == 1 && pieces > 1) printf("torn_s %.4f\n", body->time);
        if (pieces > 1 && ++after * t->dt >= 0.05) break;
    }
    return status;
}

static dgfem_vec3 deformed(void *user, int element, int vertex) {
    const dgfem_body *body = (const dgfem_body *)user;
    dgfem_vec3 x = body->mesh->vertices[vertex], u = dgfem_body_displacement(body, element, x);
    x.x += u.x, x.y += u.y, x.z += u.z;
    return x;
}

/* Elements with their largest principal stress. */
static int write_vtu(const char *path, dgfem_body *body) {
    size_t n = (size_t)body->mesh->element_count;
    double *stress = (double *)malloc(n * sizeof *stress);
    formats_cell_data data;
    formats_error error;
    if (!stress) return 0;
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfem_real values[3];
        dgfem_body_mean_principal_stress(body, e, values, NULL);
        stress[e] = (double)values[2];
    }
    data.name = "tension", data.components = 1, data.values = stress;
    int ok = formats_write_vtu(path, body->mesh, deformed, body, &data, 1, &error);
    if (!ok) fprintf(stderr, "%s\n", error.text);
    free(stress);
    return ok;
}

static int write_obj(const char *path, const dgfem_body *body) {
    dgfem_surface *surface;
    formats_error error;
    if (dgfem_surface_create(body, &surface)) return 0;
    int ok = formats_write_obj(path, dgfem_points_in_vec3(surface->positions, surface->vertex_count),
                               dgfem_points_in_vec3(surface->normals, surface->vertex_count), surface->triangles,
                               surface->triangle_count, &error);
    if (!ok) fprintf(stderr, "%s\n", error.text);
    dgfem_surface_destroy(surface);
    return ok;
}

int main(int argc, char **argv) {
    tear t = read_options(argc, argv);
    dgfem_fracture_info total;
    int ends[2], pieces;
    dgfem_body *body = make_body(&t, ends);
    if (!body) return 1;
    dgfem_status status = run(&t, body, ends, &total);
    if (!status) status = dgfem_body_pieces(body, NULL, NULL, 0, &pieces);
    if (!status) {
        printf("faces_broken %d\nelements_split %d\n", total.faces_broken, total.elements_split);
        printf("elements %d\npieces %d\nvolume %.15g\n", body->mesh->element_count, pieces,
               (double)dgfem_mesh_volume(body->mesh));
        if (t.vtu && !write_vtu(t.vtu, body)) status = DGFEM_ERROR_ARGUMENT;
        if (t.obj && !write_obj(t.obj, body)) status = DGFEM_ERROR_ARGUMENT;
    }
    dgfem_body_destroy(body);
    return status ? 1 : 0;
}
