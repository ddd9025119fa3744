/* The sparse Cholesky factorization beside CHOLMOD with OpenBLAS, in the same run, repeat by repeat in turns, one thread
   each: analyse, factor and solve, on grids of hexahedra coupled across their faces, 12 unknowns each (degree 1) or 30
   (degree 2), from 1,000 to 100,000 unknowns; on matrices of nodes, as shells and mean value coordinates have them; and
   the fill of the orderings on sliced bodies.

       bench_solver [--large] [--quick] [--nodes] [--fill] [--cpu] [--simd none|sse2|avx2|avx512] [--csv FILE]

   Times are the least of several repeats. --cpu counts the processor's time in place of the wall's, for machines that
   others use at the same time. --large goes on to 300,000 unknowns, --quick takes 12,000, 30,000 and 49,152 alone,
   --nodes the matrices of nodes alone, --fill the orderings; --simd is the instruction set that dgfem uses. OpenBLAS
   chooses its own, which is printed: one older than the processor may choose AVX2 where there is AVX-512.
   OPENBLAS_CORETYPE=SkylakeX has it use AVX-512, =Haswell AVX2, =Nehalem SSE. CHOLMOD is there when the program is
   built with -DHAVE_CHOLMOD and linked with -lcholmod -lopenblas, as `make bench` does; OMP_THREAD_LIMIT=1 and
   OPENBLAS_NUM_THREADS=1 must be set, for it uses OpenMP in its assembly.

   CHOLMOD's best setting is chosen for each size from: METIS or AMD on the unknowns, METIS or AMD on the blocks. The
   given order is dgfem's own, whose time is not counted for CHOLMOD. Figures go to build/bench/solver.csv as well. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "bench.h"
#include "formats.h"
#include "lattice.h"
#include "model.h"
#include "nodes.h"
#include "peers.h"
#include "program.h"

/* ---- the systems ---- */

/* Noise off the diagonal, and a diagonal that dominates it. */
static void fill_matrix(dgfem_matrix *matrix) {
    double *sum = (double *)room((size_t)matrix->size, sizeof *sum);
    for (int i = 0; i < matrix->block_count; i++) {
        int rows = matrix->offset[i + 1] - matrix->offset[i];
        for (int k = matrix->row_start[i]; k < matrix->row_start[i + 1]; k++) {
            dgfem_real *block = matrix->values + matrix->value_start[k];
            int first = matrix->offset[matrix->column[k]], columns = matrix->offset[matrix->column[k] + 1] - first;
            for (int j = 0; j < rows * columns; j++) {
                block[j] = noise();
                sum[matrix->offset[i] + j / columns] += fabs((double)block[j]);
                sum[first + j % columns] += fabs((double)block[j]);
            }
            if (matrix->column[k] != i) continue;
            for (int a = 0; a < rows; a++)
                for (int b = 0; b < a; b++) block[b * rows + a] = block[a * rows + b];
        }
    }
    for (int i = 0; i < matrix->block_count; i++) {
        int rows = matrix->offset[i + 1] - matrix->offset[i];
        dgfem_real *block = dgfem_matrix_block(matrix, i, i);
        for (int a = 0; a < rows; a++) block[a * rows + a] = (dgfem_real)(sum[matrix->offset[i] + a] + 1);
    }
    free(sum);
}

static dgfem_matrix *make_grid(int n, int width) {
    int count = n * n * n, pairs = 0;
    int *sizes = (int *)room((size_t)count, sizeof(int)), *pair = (int *)room((size_t)count * 6, sizeof(int));
    dgfem_vec3 *centres = (dgfem_vec3 *)room((size_t)count, sizeof(dgfem_vec3));
    dgfem_matrix_desc desc = dgfem_default_matrix_desc();
    dgfem_matrix *matrix;
    for (int i = 0; i < count; i++) {
        int place[3], step[3] = {1, n, n * n};
        place[0] = i % n, place[1] = i / n % n, place[2] = i / (n * n);
        sizes[i] = width;
        centres[i] = dgfemi_vec3((dgfem_real)place[0], (dgfem_real)place[1], (dgfem_real)place[2]);
        for (int k = 0; k < 3; k++)
            if (place[k] > 0) {
                pair[2 * pairs] = i;
                pair[2 * pairs++ + 1] = i - step[k];
            }
    }
    desc.block_count = count;
    desc.block_sizes = sizes;
    desc.pairs = pair;
    desc.pair_count = pairs;
    desc.centres = centres;
    expect(dgfem_matrix_create(&desc, &matrix) == DGFEM_OK, "dgfem_matrix_create");
    fill_matrix(matrix);
    free(sizes);
    free(pair);
    free(centres);
    return matrix;
}

/* ---- dgfem ---- */

/* What an analysed system keeps, and its order. */
static void analyse_once(const dgfem_matrix *matrix, figures *f, int *order) {
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_cholesky *cholesky = NULL;
    counted memory;
    memset(&memory, 0, sizeof memory);
    desc.hooks = bench_hooks(&memory);
    expect(dgfem_cholesky_create(matrix, &desc, &cholesky) == DGFEM_OK, "dgfem_cholesky_create");
    f->bytes = memory.live;
    memcpy(order, cholesky->order, (size_t)matrix->block_count * sizeof *order);
    dgfem_cholesky_destroy(cholesky);
}

static void run_dgfem(const dgfem_matrix *matrix, dgfem_simd simd, const dgfem_real *b, dgfem_real *x, figures *f) {
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_cholesky *cholesky = NULL;
    dgfem_cholesky_info info;
    double t0 = seconds(), t1, t2;
    desc.simd = simd;
    expect(dgfem_cholesky_create(matrix, &desc, &cholesky) == DGFEM_OK, "dgfem_cholesky_create");
    t1 = seconds();
    expect(dgfem_cholesky_factor(cholesky, matrix, &info) == DGFEM_OK, "dgfem_cholesky_factor");
    t2 = seconds();
    expect(dgfem_cholesky_solve(cholesky, b, x) == DGFEM_OK, "dgfem_cholesky_solve");
    record(f, t0, t1, t2, seconds());
    f->flops = info.factor_flops;
    f->entries = info.factor_entries;
    dgfem_cholesky_destroy(cholesky);
    if (f->count == 1) f->residual = residual(matrix, b, x);
}

static double time_product(const dgfem_matrix *matrix, const dgfem_real *b, dgfem_real *x) {
    double best = 1e300;
    for (int k = 0; k < 20; k++) {
        double t = seconds();
        dgfem_matrix_multiply(matrix, b, x);
        best = fmin(best, seconds() - t);
    }
    return best;
}

/* ---- tables ---- */

static void print_head(const char *what, const dgfem_matrix *matrix) {
    printf("\n%s: %d unknowns\n", what, matrix->size);
    printf("  %-20s %9s %9s %8s %9s %9s %8s %8s %7s %8s %8s\n", "least ms", "analyse", "factor", "solve", "all",
           "(median)", "GFLOP", "GFLOP/s", "1e6 L", "MB", "residual");
}

static void print(const char *name, const figures *f) {
    double factor = least(f->factor, f->count);
    printf("  %-20s %9.2f %9.2f %8.2f %9.2f %9.2f %8.3f %8.1f %7.2f %8.1f %8.1e\n", name,
           1e3 * least(f->analyse, f->count), 1e3 * factor, 1e3 * least(f->solve, f->count),
           1e3 * least(f->all, f->count), 1e3 * median(f->all, f->count), 1e-9 * f->flops, 1e-9 * f->flops / factor,
           1e-6 * f->entries, 1e-6 * f->bytes, f->residual);
}

static void write_csv(FILE *csv, int width, const dgfem_matrix *matrix, const char *name, const figures *f) {
    if (!csv) return;
    fprintf(csv, "%d,%d,%s,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g\n", width, matrix->size, name,
            least(f->analyse, f->count), least(f->factor, f->count), least(f->solve, f->count), least(f->all, f->count),
            median(f->all, f->count), f->flops, f->entries, f->bytes);
}

#ifdef HAVE_CHOLMOD
static void print_ratio(const char *name, const figures *own, const figures *other) {
    printf("  %-20s %9.2f %9.2f %8.2f %9.3f %9.3f %8.3f\n", name,
           least(own->analyse, own->count) / least(other->analyse, other->count),
           least(own->factor, own->count) / least(other->factor, other->count),
           least(own->solve, own->count) / least(other->solve, other->count),
           least(own->all, own->count) / least(other->all, other->count),
           median(own->all, own->count) / median(other->all, other->count), own->flops / other->flops);
}
#endif

/* Frees the matrix. */
static void bench_matrix(const char *what, dgfem_matrix *matrix, dgfem_simd simd, FILE *csv) {
    dgfem_real *b = (dgfem_real *)room((size_t)matrix->size, sizeof(dgfem_real));
    dgfem_real *x = (dgfem_real *)room((size_t)matrix->size, sizeof(dgfem_real));
    int *order = (int *)room((size_t)matrix->block_count, sizeof(int));
    int width = matrix->offset[1], repeats = matrix->size < 15000 ? 15 : matrix->size < 60000 ? 5 : 2;
    figures own;
    memset(&own, 0, sizeof own);
    for (int i = 0; i < matrix->size; i++) b[i] = noise();
    analyse_once(matrix, &own, order);
    print_head(what, matrix);
#ifdef HAVE_CHOLMOD
    figures stock, given;
    cholmod_common common;
    char name[64];
    memset(&stock, 0, sizeof stock);
    memset(&given, 0, sizeof given);
    cholmod_start(&common);
    cholmod_sparse *a = to_cholmod(matrix, &common);
    setting best = best_setting(matrix, a, b, x, &common);
    for (int k = 0; k < repeats; k++) {
        run_dgfem(matrix, simd, b, x, &own);
        run_cholmod(matrix, a, best, order, b, x, &stock, &common);
        run_dgfem(matrix, simd, b, x, &own);
        run_cholmod(matrix, a, GIVEN, order, b, x, &given, &common);
    }
    cholmod_free_sparse(&a, &common);
    cholmod_finish(&common);
    print("dgfem", &own);
    snprintf(name, sizeof name, "CHOLMOD, %s", setting_names[best]);
    print(name, &stock);
    print("CHOLMOD, our order", &given);
    print_ratio("ratio to stock", &own, &stock);
    print_ratio("ratio to our order", &own, &given);
    write_csv(csv, width, matrix, "cholmod", &stock);
    write_csv(csv, width, matrix, "cholmod_given", &given);
#else
    for (int k = 0; k < repeats; k++) run_dgfem(matrix, simd, b, x, &own);
    print("dgfem", &own);
#endif
    printf("  product %.3f ms\n", 1e3 * time_product(matrix, b, x));
    write_csv(csv, width, matrix, "dgfem", &own);
    fflush(stdout);
    free(b);
    free(x);
    free(order);
    dgfem_matrix_destroy(matrix);
}

static void bench_grid(int n, int width, dgfem_simd simd, FILE *csv) {
    char what[64];
    snprintf(what, sizeof what, "%d^3 hexahedra of %d unknowns", n, width);
    bench_matrix(what, make_grid(n, width), simd, csv);
}

/* The bunny, where that is at hand. */
static void read_model(formats_surface *surface, const char **name) {
    formats_error error;
    const char *path = "build/bunny.obj";
    FILE *file = fopen(path, "r");
    int found = file != NULL;
    if (file) fclose(file);
    if (found && !formats_read_surface(path, surface, &error)) found = 0;
    if (!found) expect(model_make(surface), "the built-in shape");
    *name = found ? path : "shape";
}

static dgfem_matrix *with_values(dgfem_matrix *matrix) {
    fill_matrix(matrix);
    return matrix;
}

static void bench_nodes(dgfem_simd simd, FILE *csv) {
    formats_surface surface;
    formats_tetrahedra mesh;
    const char *name;
    read_model(&surface, &name);
    expect(lattice_fill(&surface, 27, &mesh), "lattice_fill");
    formats_free_surface(&surface);
    bench_matrix("shell of 31 x 31 quadrilaterals, 3 a node", with_values(nodes_shell(31, 31)), simd, csv);
    bench_matrix("tetrahedra, 3 a node", with_values(nodes_tetrahedra(&mesh)), simd, csv);
    bench_matrix("20^3 hexahedra, 3 a node", with_values(nodes_hexahedra(20)), simd, csv);
    formats_free_tetrahedra(&mesh);
}

/* ---- fill on sliced bodies ---- */

static double fill_of(const dgfem_matrix *matrix, dgfem_ordering ordering) {
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_cholesky *cholesky = NULL;
    desc.ordering = ordering;
    expect(dgfem_cholesky_create(matrix, &desc, &cholesky) == DGFEM_OK, "dgfem_cholesky_create");
    double flops = cholesky->factor_flops;
    dgfem_cholesky_destroy(cholesky);
    return flops;
}

#ifdef HAVE_CHOLMOD
/* Counted by the same tree as dgfem's own orders. */
static double fill_of_peer(const dgfem_matrix *matrix, setting how) {
    dgfemi_arena arena = dgfemi_arena_make(&matrix->hooks);
    int *order = (int *)room((size_t)matrix->block_count, sizeof(int));
    dgfemi_graph graph;
    cholmod_common common;
    double flops = 0;
    cholmod_start(&common);
    order_blocks(matrix, how, order, &common);
    cholmod_finish(&common);
    expect(dgfemi_graph_make(&arena, matrix, &graph) && dgfemi_order_flops(&arena, &graph, order, &flops), "order");
    dgfemi_arena_free(&arena);
    free(order);
    return flops;
}
#endif

static void bench_fill(const formats_surface *surface, int cells) {
    dgfem_slice_desc slice = dgfem_default_slice_desc();
    dgfem_body_desc desc = dgfem_default_body_desc();
    dgfem_mesh *mesh = NULL;
    dgfem_body *body = NULL;
    slice.vertices = dgfem_points_in_double(surface->vertices, surface->vertex_count);
    slice.triangles = surface->triangles;
    slice.triangle_count = surface->triangle_count;
    slice.cells = cells;
    slice.sliver = 0;
    expect(dgfem_mesh_create_slices(&slice, &mesh) == DGFEM_OK, "dgfem_mesh_create_slices");
    desc.mesh = mesh;
    expect(dgfem_body_create(&desc, &body) == DGFEM_OK, "dgfem_body_create");
    printf("  %7d %9.4f %9.4f %9.4f", body->matrix->block_count, 1e-9 * fill_of(body->matrix, DGFEM_ORDERING_AUTO),
           1e-9 * fill_of(body->matrix, DGFEM_ORDERING_NESTED_DISSECTION),
           1e-9 * fill_of(body->matrix, DGFEM_ORDERING_MINIMUM_DEGREE));
#ifdef HAVE_CHOLMOD
    printf(" %9.4f %9.4f", 1e-9 * fill_of_peer(body->matrix, BLOCKS_METIS), 1e-9 * fill_of_peer(body->matrix, BLOCKS_AMD));
#endif
    printf("\n");
    dgfem_body_destroy(body);
}

static void bench_bodies(void) {
    static const int cells[4] = {6, 11, 20, 24};
    formats_surface surface;
    const char *name;
    read_model(&surface, &name);
    printf("\nGFLOP of a factorization: sliced %s\n  %7s %9s %9s %9s", name, "blocks", "auto",
           "dissect", "min.deg.");
#ifdef HAVE_CHOLMOD
    printf(" %9s %9s", "METIS", "AMD");
#endif
    printf("\n");
    for (int k = 0; k < 4; k++) bench_fill(&surface, cells[k]);
    formats_free_surface(&surface);
}

int main(int argc, char **argv) {
    static const char *const names[5] = {"auto", "none", "sse2", "avx2", "avx512"};
    static const int cells[2][10] = {{4, 6, 8, 10, 12, 16, 20, 24, 29, 0}, {3, 4, 6, 8, 10, 12, 15, 18, 21, 0}};
    program p = program_begin(
        argc, argv, "bench_solver [--large] [--quick] [--nodes] [--fill] [--cpu] [--simd NAME] [--csv FILE]");
    int large = program_flag(&p, "--large"), quick = program_flag(&p, "--quick");
    const char *name = program_text(&p, "--simd", "auto"), *path = program_text(&p, "--csv", "build/bench/solver.csv");
    use_cpu_time = program_flag(&p, "--cpu");
    int fill_only = program_flag(&p, "--fill"), nodes_only = program_flag(&p, "--nodes");
    program_end(&p);
    int simd = 0;
    while (simd < 5 && strcmp(names[simd], name) != 0) simd++;
    expect(simd < 5, "--simd");
    FILE *csv = fopen(path, "w");
    if (!csv) fprintf(stderr, "bench_solver: %s cannot be written\n", path);
    if (csv) fprintf(csv, "width,unknowns,solver,analyse,factor,solve,all,all_median,flops,entries,bytes\n");
#ifdef HAVE_CHOLMOD
    printf("OpenBLAS for %s\n", openblas_get_corename());
#endif
    if (fill_only) {
        bench_bodies();
    } else if (nodes_only) {
        bench_nodes((dgfem_simd)simd, csv);
    } else if (quick) {
        bench_grid(10, 12, (dgfem_simd)simd, csv);
        bench_grid(10, 30, (dgfem_simd)simd, csv);
        bench_grid(16, 12, (dgfem_simd)simd, csv);
        bench_nodes((dgfem_simd)simd, csv);
    } else {
        for (int degree = 0; degree < 2; degree++)
            for (int k = 0; cells[degree][k] && (large || k < 7); k++)
                bench_grid(cells[degree][k], degree ? 30 : 12, (dgfem_simd)simd, csv);
        bench_nodes((dgfem_simd)simd, csv);
        bench_bodies();
    }
    if (csv) fclose(csv);
    return 0;
}
