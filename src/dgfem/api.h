#pragma once
/* Public types and declarations. */
#include <stddef.h>

/* ---- configuration ------------------------------------------------------------------------------------------- */

#ifndef DGFEM_REAL
#define DGFEM_REAL double
#endif

/* DGFEM_REAL_IS_FLOAT is 1 for float, 0 for double; any other type stops here with an error. */
#define DGFEM_PASTE_(a, b) a##b
#define DGFEM_PASTE(a, b) DGFEM_PASTE_(a, b)
#define DGFEM_TYPE_IS_float 1
#define DGFEM_TYPE_IS_double 2
#if DGFEM_PASTE(DGFEM_TYPE_IS_, DGFEM_REAL) == 1
#define DGFEM_REAL_IS_FLOAT 1
#elif DGFEM_PASTE(DGFEM_TYPE_IS_, DGFEM_REAL) == 2
#define DGFEM_REAL_IS_FLOAT 0
#else
#error "dgfem: DGFEM_REAL must be float or double"
#endif

/* A literal in the configured precision: DGFEM_R(0.5). */
#define DGFEM_R(literal) ((dgfem_real)(literal))

#ifndef DGFEM_API
#if defined(DGFEM_STATIC) && defined(__GNUC__)
#define DGFEM_API __attribute__((unused)) static
#elif defined(DGFEM_STATIC)
#define DGFEM_API static
#elif defined(__cplusplus)
#define DGFEM_API extern "C"
#else
#define DGFEM_API extern
#endif
#endif

/* Objects made with one precision must not reach code compiled for the other: in single precision the creating
   functions have another link name, so that a mix of the two fails when the program is linked. */
#if DGFEM_REAL_IS_FLOAT
#define dgfem_polyhedron_create dgfem_polyhedron_create_float
#define dgfem_mesh_create_grid dgfem_mesh_create_grid_float
#define dgfem_mesh_create_tetrahedra dgfem_mesh_create_tetrahedra_float
#define dgfem_mesh_create_polyhedra dgfem_mesh_create_polyhedra_float
#define dgfem_mesh_create_slices dgfem_mesh_create_slices_float
#define dgfem_matrix_create dgfem_matrix_create_float
#define dgfem_cholesky_create dgfem_cholesky_create_float
#define dgfem_body_create dgfem_body_create_float
#define dgfem_embedding_create dgfem_embedding_create_float
#define dgfem_skin_create dgfem_skin_create_float
#define dgfem_surface_create dgfem_surface_create_float
#endif

/* ---- basic types --------------------------------------------------------------------------------------------- */

typedef DGFEM_REAL dgfem_real;

typedef struct dgfem_vec3 {
    dgfem_real x, y, z;
} dgfem_vec3;

typedef struct dgfem_mat3 {
    dgfem_real m[3][3]; /* [row][column] */
} dgfem_mat3;

/* All points with dot(normal, x) == offset. The normal need not have unit length unless a function says so. */
typedef struct dgfem_plane {
    dgfem_vec3 normal;
    dgfem_real offset;
} dgfem_plane;

/* "No element", "no face", ... wherever an index may be absent. */
#define DGFEM_NONE (-1)

/* The largest degree of the polynomial basis, and of the moments that serve it. */
#define DGFEM_MAX_DEGREE 3
#define DGFEM_MAX_MOMENT_DEGREE 6

/* Every result of a call that can fail. One list makes the enum and the texts of dgfem_status_text. */
#define DGFEM_STATUS_LIST(X)                                                                   \
    X(OK, "success")                                                                           \
    X(ERROR_MEMORY, "out of memory")                                                           \
    X(ERROR_DESCRIPTOR, "descriptor was not made by its default function")                     \
    X(ERROR_ARGUMENT, "invalid argument")                                                      \
    X(ERROR_INDEX, "index out of range")                                                       \
    X(ERROR_NOT_FINITE, "a number is NaN or infinite")                                         \
    X(ERROR_EMPTY, "nothing there: no faces, no triangles or no cells")                        \
    X(ERROR_OPEN, "surface is not closed: a directed edge lacks its opposite")                 \
    X(ERROR_INSIDE_OUT, "surface is inside out: its volume is negative")                       \
    X(ERROR_NOT_PLANAR, "a face is not planar")                                                \
    X(ERROR_DEGENERATE, "degenerate geometry: zero length, area or volume")                    \
    X(ERROR_NOT_SIMPLE, "a loop crosses or touches itself")                                    \
    X(ERROR_NOT_CONFORMING, "neighbouring elements do not share their faces")                  \
    X(ERROR_INVARIANT, "an invariant of the mesh is broken")                                   \
    X(ERROR_MATERIAL, "material value out of range")                                           \
    X(ERROR_NOT_POSITIVE_DEFINITE, "matrix is not positive definite")                          \
    X(ERROR_NOT_CONVERGED, "iteration did not converge")                                       \
    X(ERROR_UNCONSTRAINED, "static problem without constraint")                                \
    X(ERROR_REVISION, "object was made for an earlier topology of the body")

typedef enum dgfem_status {
#define DGFEM_STATUS_ENUM(name, text) DGFEM_##name,
    DGFEM_STATUS_LIST(DGFEM_STATUS_ENUM)
#undef DGFEM_STATUS_ENUM
    DGFEM_STATUS_COUNT
} dgfem_status;

/* A short English text, never NULL. */
DGFEM_API const char *dgfem_status_text(dgfem_status status);

typedef enum dgfem_log_level { DGFEM_LOG_INFO, DGFEM_LOG_WARNING, DGFEM_LOG_ERROR } dgfem_log_level;

/* A loop body: work on the indices first <= i < last. */
typedef void (*dgfem_range_fn)(void *context, int first, int last);

/* What the host lends to an object. Every member may be NULL, which means: libc's allocator, silence, one thread, no
   clock. The object keeps a copy; the user pointers must outlive it.

   reallocate    as realloc: pointer NULL allocates, size 0 frees and returns NULL, failure returns NULL and keeps the
                 old memory. Memory must be aligned for any type.
   log           one complete line, without line feed, for each error (and little else).
   parallel_for  calls fn for disjoint ranges that together cover 0 <= i < count, each of about `grain` indices, from
                 any threads in any order, and returns when all are done. Results never depend on the ranges.
   clock         seconds since any fixed time; fills the seconds_* members of dgfem_step_info. */
typedef struct dgfem_hooks {
    void *(*reallocate)(void *user, void *pointer, size_t size);
    void *reallocate_user;
    void (*log)(void *user, dgfem_log_level level, const char *text);
    void *log_user;
    void (*parallel_for)(void *user, int count, int grain, dgfem_range_fn fn, void *context);
    void *parallel_for_user;
    double (*clock)(void *user);
    void *clock_user;
} dgfem_hooks;

/* Triples of numbers in the caller's memory. The stride is in bytes; 0 means tightly packed. */
typedef enum dgfem_number { DGFEM_FLOAT32, DGFEM_FLOAT64 } dgfem_number;

typedef struct dgfem_points_in {
    const void *data;
    dgfem_number type;
    int stride;
    int count;
} dgfem_points_in;

typedef struct dgfem_points_out {
    void *data;
    dgfem_number type;
    int stride;
    int count; /* room for this many points; must be at least what the call writes */
} dgfem_points_out;

DGFEM_API dgfem_points_in dgfem_points_in_float(const float *data, int count);
DGFEM_API dgfem_points_in dgfem_points_in_double(const double *data, int count);
DGFEM_API dgfem_points_in dgfem_points_in_vec3(const dgfem_vec3 *data, int count);
DGFEM_API dgfem_points_out dgfem_points_out_float(float *data, int count);
DGFEM_API dgfem_points_out dgfem_points_out_double(double *data, int count);
DGFEM_API dgfem_points_out dgfem_points_out_vec3(dgfem_vec3 *data, int count);

/* ---- rotations ----------------------------------------------------------------------------------------------- */

/* The rotation R of the polar decomposition F = R S, det R = +1, also for inverted F. Where F is too close to
   singular to have one (sigma_2 + sigma_3 <= 1e-6 sigma_1, in float 1e-4 sigma_1), `fallback` is returned (pass the
   last rotation). */
DGFEM_API dgfem_mat3 dgfem_rotation_of(dgfem_mat3 f, dgfem_mat3 fallback);

/* Eigenvalues, ascending, and the matching unit eigenvectors (columns, right-handed) of a symmetric matrix. */
DGFEM_API void dgfem_eigen_symmetric(dgfem_mat3 a, dgfem_real values[3], dgfem_mat3 *vectors);

/* ---- monomials and their integrals --------------------------------------------------------------------------- */

/* Monomials x^i y^j z^k are ordered by degree, within a degree by i descending, then j descending:
   1 | x y z | xx xy xz yy yz zz | xxx xxy ...   Number of all up to `degree`: 1, 4, 10, 20, 35, 56, 84. */
DGFEM_API int dgfem_monomial_count(int degree);
DGFEM_API int dgfem_monomial_index(int i, int j, int k);

/* ---- polyhedron ---------------------------------------------------------------------------------------------- */

/* A polyhedron of planar faces. A face has one or more loops: one or more outer loops and their holes. Seen from
   outside, outer loops run counter-clockwise and holes clockwise. Non-convex faces, holes, enclosed voids and several
   components are all allowed.

   Layout (all arrays are the caller's, copied):
     vertices[vertex_count]
     face f has the loops     face_loops[f] <= l < face_loops[f + 1]
     loop l has the vertices  loop_vertices[i],  loop_start[l] <= i < loop_start[l + 1]
   face_loops may be NULL: then every face has one loop. */
typedef struct dgfem_polyhedron_desc {
    unsigned cookie;
    const dgfem_vec3 *vertices;
    int vertex_count;
    int face_count;
    const int *face_loops;    /* [face_count + 1] or NULL */
    const int *loop_start;    /* [face_loops[face_count] + 1] */
    const int *loop_vertices; /* [loop_start[last]] */
    dgfem_hooks hooks;
} dgfem_polyhedron_desc;

typedef struct dgfem_polyhedron {
    dgfem_vec3 *vertices;
    int vertex_count;
    int face_count;
    int *face_loops;    /* [face_count + 1] */
    int *loop_start;    /* [face_loops[face_count] + 1] */
    int *loop_vertices; /* [loop_start[last]] */
    dgfem_hooks hooks;
} dgfem_polyhedron;

typedef struct dgfem_measure {
    dgfem_real volume;
    dgfem_real area;
    dgfem_vec3 centroid;
    dgfem_vec3 lower, upper; /* bounding box */
} dgfem_measure;

DGFEM_API dgfem_polyhedron_desc dgfem_default_polyhedron_desc(void);

/* Copies the description. Refuses NaN, indices out of range, loops of fewer than three vertices or with a vertex
   twice in a row. Does not need a closed surface: that is dgfem_polyhedron_check's. */
DGFEM_API dgfem_status dgfem_polyhedron_create(const dgfem_polyhedron_desc *desc, dgfem_polyhedron **out);
DGFEM_API void dgfem_polyhedron_destroy(dgfem_polyhedron *polyhedron);

/* DGFEM_OK when it is closed (each directed edge as often as its opposite), each face planar (within `tolerance` times
   the size of the bounding box) and simple (no loop crosses or touches itself or another loop of its face), and the
   volume positive; else the status that says which, and a log line that names face, edge or vertex. */
DGFEM_API dgfem_status dgfem_polyhedron_check(const dgfem_polyhedron *polyhedron, dgfem_real tolerance);

/* Signed volume, surface area, centroid, bounding box. */
DGFEM_API dgfem_measure dgfem_polyhedron_measure(const dgfem_polyhedron *polyhedron);

/* 1 inside, 0 outside, by the winding number; a point on the surface may give either. */
DGFEM_API int dgfem_polyhedron_contains(const dgfem_polyhedron *polyhedron, dgfem_vec3 point);

/* out[dgfem_monomial_index(i,j,k)] = integral of (x-cx)^i (y-cy)^j (z-cz)^k over the interior, i + j + k <= degree,
   0 <= degree <= DGFEM_MAX_MOMENT_DEGREE. Exact but for round-off: error below about 1e-15 h^d V with h the largest
   distance of a vertex from the centre. Keep the centre close: moments about a far point lose digits by nature. The
   surface must be closed; of an open one the numbers mean nothing. */
DGFEM_API dgfem_status dgfem_polyhedron_moments(const dgfem_polyhedron *polyhedron, int degree, dgfem_vec3 centre,
                                                dgfem_real *out);

/* The same integrals over one planar face (surface measure). */
DGFEM_API dgfem_status dgfem_polyhedron_face_moments(const dgfem_polyhedron *polyhedron, int face, int degree,
                                                     dgfem_vec3 centre, dgfem_real *out);

/* Triangles (three vertex indices each, counter-clockwise from outside) that cover the face exactly, also where it is
   not convex or has holes; no new vertices. Writes at most `capacity` triangles and sets *count to the number needed:
   call with capacity 0 to ask (corners of all loops + 2 * (loops - 1) always suffices). A face that is not simple gets
   triangles with the right boundary that may overlap. */
DGFEM_API dgfem_status dgfem_polyhedron_triangulate_face(const dgfem_polyhedron *polyhedron, int face, int *triangles,
                                                         int capacity, int *count);

/* The parts with dot(normal, x) < offset (below) and >= offset (above); *below or *above is NULL where there is none.
   Each part is closed by correct caps, holes included, and may consist of several components. */
DGFEM_API dgfem_status dgfem_polyhedron_split(const dgfem_polyhedron *polyhedron, dgfem_plane plane,
                                              dgfem_polyhedron **below, dgfem_polyhedron **above);

/* Number of components (a void counts with the component that encloses it), and the k-th as a new polyhedron. */
DGFEM_API dgfem_status dgfem_polyhedron_component_count(const dgfem_polyhedron *polyhedron, int *count);
DGFEM_API dgfem_status dgfem_polyhedron_component(const dgfem_polyhedron *polyhedron, int k, dgfem_polyhedron **out);

/* ---- mesh ---------------------------------------------------------------------------------------------------- */

typedef struct dgfem_loop {
    int start, count; /* range of dgfem_mesh.loop_vertices */
} dgfem_loop;

/* One planar polygon, an outer loop (or several) and its holes, between two elements or on the boundary. There is one
   copy for both sides. Loops run counter-clockwise seen from the tip of the normal. */
typedef struct dgfem_face {
    int element[2];             /* the normal points out of element[0] into element[1]; element[1] is DGFEM_NONE on the boundary */
    int loop_start, loop_count; /* range of dgfem_mesh.loops */
    int cut;                    /* 0: both sides are glued; 1: they are separated */
    int tag;                    /* what the face came from: box side 0..5 (-x +x -y +y -z +z), surface triangle; else DGFEM_NONE */
    dgfem_vec3 normal;          /* unit */
    dgfem_vec3 centre;          /* area centroid */
    dgfem_real area;
} dgfem_face;

typedef struct dgfem_element {
    int face_start, face_count; /* range of dgfem_mesh.element_faces */
    int tag;                    /* caller's; grid cell or polyhedron that it came from; children inherit it */
    dgfem_vec3 centre;          /* volume centroid */
    dgfem_real volume;
    dgfem_real radius;          /* largest distance of a vertex from the centre */
} dgfem_element;

/* The cell complex. Read freely; change only through functions. */
typedef struct dgfem_mesh {
    dgfem_vec3 *vertices;
    dgfem_face *faces;
    dgfem_element *elements;
    dgfem_loop *loops;
    int *loop_vertices;
    int *element_faces;
    int vertex_count, face_count, element_count, loop_count, loop_vertex_count, element_face_count;
    int vertex_capacity, face_capacity, element_capacity, loop_capacity, loop_vertex_capacity, element_face_capacity;
    dgfem_hooks hooks;
} dgfem_mesh;

typedef struct dgfem_grid_desc {
    unsigned cookie;
    dgfem_vec3 lower, upper; /* opposite corners; default the unit cube */
    int cells[3];            /* along x, y, z; default 1 1 1 */
    dgfem_hooks hooks;
} dgfem_grid_desc;

typedef struct dgfem_tetrahedra_desc {
    unsigned cookie;
    dgfem_points_in vertices;
    const int *tetrahedra; /* four vertex indices each, positively oriented: det(b-a, c-a, d-a) > 0 */
    int tetrahedron_count;
    dgfem_hooks hooks;
} dgfem_tetrahedra_desc;

typedef struct dgfem_weld_desc {
    unsigned cookie;
    dgfem_real tolerance; /* vertices closer than this times the bounding box become one; default 1e-9 (float: 1e-5) */
    dgfem_hooks hooks;
} dgfem_weld_desc;

typedef struct dgfem_slice_info {
    int triangles;            /* of the surface */
    int elements_raw;         /* before slivers were merged */
    int slivers_merged;       /* elements that vanished into a neighbour */
    int slivers_left;         /* small elements without a neighbour */
    dgfem_real surface_volume, surface_area; /* of the input */
} dgfem_slice_info;

typedef struct dgfem_slice_desc {
    unsigned cookie;
    dgfem_points_in vertices;
    const int *triangles; /* three vertex indices each, counter-clockwise from outside */
    int triangle_count;
    int cells;            /* cubic cells along the longest extent, edge 1.0001 * extent / cells, grid centred; default 10 */
    int use_grid;         /* 1: the three members below instead of `cells`; default 0 */
    dgfem_vec3 grid_lower;
    dgfem_vec3 grid_cell;   /* edge lengths of one cell */
    int grid_cells[3];      /* the outermost cells extend to infinity, so that nothing is lost */
    dgfem_real sliver;    /* an element smaller than this times the cell's volume is merged; 0: none; default 1e-3 */
    int flip;             /* 1: a surface that is inside out is turned; 0 (default): it is refused */
    dgfem_slice_info *info; /* filled in when not NULL */
    dgfem_hooks hooks;
} dgfem_slice_desc;

DGFEM_API dgfem_grid_desc dgfem_default_grid_desc(void);
DGFEM_API dgfem_tetrahedra_desc dgfem_default_tetrahedra_desc(void);
DGFEM_API dgfem_weld_desc dgfem_default_weld_desc(void);
DGFEM_API dgfem_slice_desc dgfem_default_slice_desc(void);

/* A box of nx * ny * nz hexahedra. Element (i,j,k) has the index i + nx * (j + ny * k), and that as its tag. Its faces
   are listed in the order of their sides: -x +x -y +y -z +z. */
DGFEM_API dgfem_status dgfem_mesh_create_grid(const dgfem_grid_desc *desc, dgfem_mesh **out);

/* Tetrahedra with three vertex indices in common become neighbours. Element i is tetrahedron i, and has that as its tag;
   vertices keep their indices, those that no tetrahedron uses included. Face i of an element lies opposite its vertex
   i. Refuses inverted and flat tetrahedra, overlaps, and faces of more than two tetrahedra. */
DGFEM_API dgfem_status dgfem_mesh_create_tetrahedra(const dgfem_tetrahedra_desc *desc, dgfem_mesh **out);

/* Polyhedra that share whole faces (same vertices, opposite order, after welding) become neighbours; the rest is
   boundary. Element i is polyhedron i, and has that as its tag. Each must pass dgfem_polyhedron_check with the weld
   tolerance or its default, whichever is larger. */
DGFEM_API dgfem_status dgfem_mesh_create_polyhedra(const dgfem_polyhedron *const *polyhedra, int count,
                                                   const dgfem_weld_desc *desc, dgfem_mesh **out);

/* A closed triangle surface cut into polyhedra by a hexahedral grid. Boundary faces carry the index of their triangle
   as tag. Open, inside-out, NaN or zero-area input is refused, with the offender in the log. */
DGFEM_API dgfem_status dgfem_mesh_create_slices(const dgfem_slice_desc *desc, dgfem_mesh **out);

DGFEM_API dgfem_status dgfem_mesh_copy(const dgfem_mesh *mesh, dgfem_mesh **out);
DGFEM_API void dgfem_mesh_destroy(dgfem_mesh *mesh);

/* Every invariant of the cell complex: indices, closed elements, two different elements per interior face with
   opposite orientation, planar faces, positive volumes, vector areas that sum to zero, stored measures up to date.
   Numbers are compared to round-off at the mesh's place, but a face may be bent by a twentieth of an element's radius:
   splits snap. DGFEM_ERROR_INVARIANT and a log line that names the offender. */
DGFEM_API dgfem_status dgfem_mesh_check(const dgfem_mesh *mesh);

DGFEM_API dgfem_real dgfem_mesh_volume(const dgfem_mesh *mesh);
DGFEM_API dgfem_real dgfem_mesh_boundary_area(const dgfem_mesh *mesh);

/* The element as a polyhedron of its own. */
DGFEM_API dgfem_status dgfem_mesh_element_polyhedron(const dgfem_mesh *mesh, int element, dgfem_polyhedron **out);

/* Splits every element that straddles the plane; both parts stay glued along the new faces. Elements cut into several
   components become as many elements. A vertex whose distance to the plane is below `snap` times that of the other
   end of a crossing edge counts as on the plane (0: never; 1e-3 avoids most slivers). Not part of a split: elements
   that only touch the plane. *split (may be NULL) counts the elements split. */
DGFEM_API dgfem_status dgfem_mesh_split_plane(dgfem_mesh *mesh, dgfem_plane plane, dgfem_real snap, int *split);

/* Merges every element smaller than `volume`, smallest first, into the neighbour with which it shares the largest
   glued area and no cut face, unless the two also touch along an edge elsewhere. All faces between the two vanish.
   *merged and *left (may be NULL) count those that went and those that had no such neighbour. */
DGFEM_API dgfem_status dgfem_mesh_merge_slivers(dgfem_mesh *mesh, dgfem_real volume, int *merged, int *left);

/* Corners: classes of (vertex, element) pairs connected through glued faces around the vertex. Where all is glued
   there is one corner per vertex; a cut makes several. They are the stitch nodes of eq. (30). */
typedef struct dgfem_corners {
    int count;
    int *vertex;         /* [count] mesh vertex of each corner */
    int *element_start;  /* [count + 1] */
    int *elements;       /* incident elements of corner c: element_start[c] <= i < element_start[c + 1], ascending */
    int *corner_start;   /* [element_count + 1] */
    int *corners;        /* corners of element e: corner_start[e] <= i < corner_start[e + 1], ascending */
    dgfem_hooks hooks;
} dgfem_corners;

DGFEM_API dgfem_status dgfem_mesh_corners(const dgfem_mesh *mesh, dgfem_corners **out);
DGFEM_API void dgfem_corners_destroy(dgfem_corners *corners);

/* ---- sparse symmetric block matrix and its solvers ----------------------------------------------------------- */

/* A symmetric matrix in dense blocks of any sizes. Stored are the diagonal blocks and the blocks below the diagonal
   that `pairs` names. */
typedef struct dgfem_matrix_desc {
    unsigned cookie;
    int block_count;
    const int *block_sizes;     /* [block_count], each >= 1 */
    const int *pairs;           /* [2 * pair_count] coupled blocks, in any order; repeats and equal ones are allowed */
    int pair_count;
    const dgfem_vec3 *centres;  /* [block_count] where each block lives, for the ordering; or NULL */
    dgfem_hooks hooks;
} dgfem_matrix_desc;

typedef struct dgfem_sharing dgfem_sharing; /* how threads share a product, opaque */

typedef struct dgfem_matrix {
    int block_count;
    int size;             /* number of unknowns */
    int *offset;          /* [block_count + 1] first unknown of each block */
    int *row_start;       /* [block_count + 1] */
    int *column;          /* of row r, ascending: row_start[r] <= k < row_start[r + 1]; the last one is r itself */
    size_t *value_start;  /* [row_start[block_count] + 1] block k: row-major, size(r) x size(column[k]) */
    dgfem_real *values;
    dgfem_vec3 *centres;  /* [block_count] or NULL */
    dgfem_sharing *sharing; /* NULL where threads share nothing */
    dgfem_hooks hooks;
} dgfem_matrix;

DGFEM_API dgfem_matrix_desc dgfem_default_matrix_desc(void);
DGFEM_API dgfem_status dgfem_matrix_create(const dgfem_matrix_desc *desc, dgfem_matrix **out); /* all values zero */
DGFEM_API void dgfem_matrix_destroy(dgfem_matrix *matrix);
DGFEM_API void dgfem_matrix_clear(dgfem_matrix *matrix);

/* The stored block (row >= column), row-major, to be read or written in place; NULL where there is none. Diagonal
   blocks are stored whole and must be symmetric (the factorization reads their lower half only). */
DGFEM_API dgfem_real *dgfem_matrix_block(const dgfem_matrix *matrix, int row, int column);

/* y = A x; x and y are different vectors of matrix->size. Large matrices use hooks.parallel_for, and memory of their
   own: then one product with a matrix at a time. */
DGFEM_API void dgfem_matrix_multiply(const dgfem_matrix *matrix, const dgfem_real *x, dgfem_real *y);

typedef enum dgfem_ordering {
    DGFEM_ORDERING_AUTO,              /* nested dissection or, without centres or if that is better, minimum degree */
    DGFEM_ORDERING_NATURAL,
    DGFEM_ORDERING_MINIMUM_DEGREE,
    DGFEM_ORDERING_NESTED_DISSECTION, /* needs the matrix's centres */
    DGFEM_ORDERING_QUICK              /* as auto, for few factorizations: minimum degree alone where these cost little */
} dgfem_ordering;

/* The instruction set that dense kernels use. Results differ in round-off from one to another. */
typedef enum dgfem_simd {
    DGFEM_SIMD_AUTO,   /* the best one that was compiled and that the machine has */
    DGFEM_SIMD_NONE,   /* plain C; the only one with DGFEM_NO_SIMD */
    DGFEM_SIMD_SSE2,   /* x86, if compiled by gcc or clang: chosen at run time */
    DGFEM_SIMD_AVX2,   /* with FMA */
    DGFEM_SIMD_AVX512, /* F */
    DGFEM_SIMD_NEON,   /* 64-bit ARM */
    DGFEM_SIMD_WASM    /* simd128 */
} dgfem_simd;

typedef struct dgfem_cholesky_desc {
    unsigned cookie;
    dgfem_ordering ordering;
    dgfem_simd simd; /* default DGFEM_SIMD_AUTO; DGFEM_ERROR_ARGUMENT where one that is asked for is not to be had */
    dgfem_hooks hooks;
} dgfem_cholesky_desc;

/* Opaque: A = L L^T under a fill-reducing permutation of the blocks. */
typedef struct dgfem_cholesky dgfem_cholesky;

typedef struct dgfem_cholesky_info {
    int failed_block;         /* the block whose pivot was not positive, or DGFEM_NONE */
    double factor_entries;    /* numbers in L, without the zeros that are stored with them */
    double factor_flops;      /* multiplications and additions of one factorization, without those on such zeros */
    int supernodes;           /* dense panels that L is stored in */
    dgfem_simd simd;          /* the instruction set in use */
} dgfem_cholesky_info;

DGFEM_API dgfem_cholesky_desc dgfem_default_cholesky_desc(void);

/* Symbolic analysis of the pattern; no values are read. Reserves all memory that factor and solve will need. */
DGFEM_API dgfem_status dgfem_cholesky_create(const dgfem_matrix *matrix, const dgfem_cholesky_desc *desc,
                                             dgfem_cholesky **out);
DGFEM_API void dgfem_cholesky_destroy(dgfem_cholesky *cholesky);

/* Factors a matrix of the pattern analysed; allocates nothing. DGFEM_ERROR_NOT_POSITIVE_DEFINITE leaves the object
   usable for another factorization; info (may be NULL) names the block. A pivot fails when it is not finite or not above
   8 epsilon times the diagonal element that it began with: of that no digit is left. Round-off can lift the pivots of
   a singular matrix above this bound; then the solution is large and has no correct digits. */
DGFEM_API dgfem_status dgfem_cholesky_factor(dgfem_cholesky *cholesky, const dgfem_matrix *matrix,
                                             dgfem_cholesky_info *info);

/* Solves A x = b by the last factorization; b and x may be the same vector. Allocates nothing: the object's own work
   vector serves one solve at a time. DGFEM_ERROR_ARGUMENT when the last factorization failed or there was none. */
DGFEM_API dgfem_status dgfem_cholesky_solve(const dgfem_cholesky *cholesky, const dgfem_real *b, dgfem_real *x);

/* The same for `count` right-hand sides, one after the other in b, and their solutions in x. L is read once for several
   of them; each solution has the bits that dgfem_cholesky_solve gives. */
DGFEM_API dgfem_status dgfem_cholesky_solve_many(const dgfem_cholesky *cholesky, int count, const dgfem_real *b,
                                                 dgfem_real *x);

typedef struct dgfem_pcg_desc {
    unsigned cookie;
    dgfem_real tolerance;  /* on |b - A x| / |b| in the norm of the inverse diagonal blocks; default 1e-8, float 1e-5 */
    int max_iterations;    /* default 1000 */
    dgfem_real *work;      /* [5 * size + values of all diagonal blocks] or NULL: allocated inside */
    dgfem_hooks hooks;
} dgfem_pcg_desc;

typedef struct dgfem_pcg_info {
    int iterations;
    dgfem_real residual;   /* relative, as in tolerance; of the x returned */
    int failed_block;      /* a diagonal block that is not positive definite, or DGFEM_NONE */
} dgfem_pcg_info;

DGFEM_API dgfem_pcg_desc dgfem_default_pcg_desc(void);

/* Number of dgfem_real that pcg's work array needs. */
DGFEM_API size_t dgfem_pcg_work_size(const dgfem_matrix *matrix);

/* Conjugate gradients with block-Jacobi; x holds the start vector and receives the result; b = 0 gives x = 0 at once.
   On DGFEM_ERROR_NOT_CONVERGED (max_iterations reached, no more progress, or a breakdown, as with an indefinite matrix)
   x is the best iterate. info may be NULL. */
DGFEM_API dgfem_status dgfem_pcg(const dgfem_matrix *matrix, const dgfem_pcg_desc *desc, const dgfem_real *b,
                                 dgfem_real *x, dgfem_pcg_info *info);

/* ---- body ---------------------------------------------------------------------------------------------------- */

typedef struct dgfem_material {
    dgfem_real young;   /* > 0, Pa */
    dgfem_real poisson; /* -1 < nu < 0.5 */
    dgfem_real density; /* > 0, kg/m^3 */
} dgfem_material;

typedef enum dgfem_flux {
    DGFEM_FLUX_IP, /* interior penalty: consistent, converges; eq. (21) */
    DGFEM_FLUX_BZ  /* Babuska-Zlamal: penalty alone, cheaper, plausible rather than accurate; eq. (19) */
} dgfem_flux;

typedef enum dgfem_penalty {
    DGFEM_PENALTY_SPLIT,  /* stiff on the jump's projection to degree p-1, soft (mu) on the rest: no locking */
    DGFEM_PENALTY_TENSOR, /* mu I + (lambda + mu) n n^T on the whole jump */
    DGFEM_PENALTY_SCALAR  /* (lambda + 2 mu) on the whole jump, as the paper; locks for p = 1 */
} dgfem_penalty;

/* What solves the linear system of a step. A static solve takes PCG where that or sweeps are chosen, and else Cholesky. */
typedef enum dgfem_solver {
    DGFEM_SOLVER_AUTO,     /* stale or sweeps, whichever pays: sweeps after a cut and in large soft bodies */
    DGFEM_SOLVER_STALE,    /* conjugate gradients preconditioned by an earlier factorization, turned with the elements */
    DGFEM_SOLVER_CHOLESKY, /* a factorization in every step: exact, and the same from the same state */
    DGFEM_SOLVER_SWEEPS,   /* conjugate gradients preconditioned by symmetric Gauss-Seidel sweeps: little memory */
    DGFEM_SOLVER_PCG       /* conjugate gradients preconditioned by the elements' own blocks, to a given residual */
} dgfem_solver;

typedef struct dgfem_body_desc {
    unsigned cookie;
    dgfem_mesh *mesh;                /* the body takes it over on success */
    dgfem_material material;         /* default 1e6 Pa, 0.3, 1000 kg/m^3 */
    const dgfem_material *materials; /* [element_count] or NULL: `material` everywhere */
    int degree;                      /* of the polynomials, 1..3; default 1 */
    const int *degrees;              /* [element_count] or NULL: `degree` everywhere */
    dgfem_flux flux;                 /* default IP */
    dgfem_penalty penalty;           /* default split */
    dgfem_real eta;                  /* penalty factor eta0; default 4, for BZ use 20 */
    dgfem_real eta_rest;             /* split: factor of the rest of the jump; default 0.5 */
    dgfem_vec3 gravity;              /* default 0 0 -9.81 m/s^2 */
    dgfem_real damping_mass;         /* Rayleigh alpha, 1/s; default 0 */
    dgfem_real damping_stiffness;    /* Rayleigh beta, s; default 0. Acts on velocities as stiffness on displacements:
                                        it brakes rigid turning, and takes moving fixtures to stand still */
    int warp;                        /* 1: stiffness warping (default); 0: linear elasticity */
    dgfem_solver solver;             /* default auto */
    dgfem_real velocity_tolerance;   /* of auto, stale, sweeps: error of the velocities relative to their mean, both as
                                        roots of mean squares over the mass, or to .01 element radii in a step;
                                        default 1e-3 */
    dgfem_real solver_tolerance;     /* of PCG; default 1e-6 (float: 1e-4) */
    int solver_iterations;           /* of PCG and sweeps at most; default 1000 */
    dgfem_hooks hooks;
} dgfem_body_desc;

typedef struct dgfem_step_info {
    int iterations;           /* of conjugate gradients; 0 with Cholesky */
    int factorizations;
    int sweeps;               /* static solve: solves with new rotations */
    int contacts;             /* contact points that were active */
    int failed_element;       /* whose pivot or block was not positive (definite), or DGFEM_NONE */
    dgfem_real residual;      /* of PCG; auto, stale, sweeps: estimated error, as in velocity_tolerance; static solve:
                                 last relative change of the displacement, without warping the relative residual of the
                                 linear system */
    double seconds_assemble, seconds_contact, seconds_factor, seconds_solve; /* 0 without a clock */
} dgfem_step_info;

/* A prescribed displacement: fills in *displacement at a material (rest) position. */
typedef void (*dgfem_displacement_fn)(void *user, dgfem_vec3 rest, dgfem_vec3 *displacement);

typedef struct dgfem_static_desc {
    unsigned cookie;
    int load_steps;         /* loads and all prescribed displacements grow in equal steps from none; default 1 */
    int max_sweeps;         /* per load step; default 60 */
    dgfem_real tolerance;   /* on the change of the displacement relative to its size; default 1e-9 (float: 1e-4) */
} dgfem_static_desc;

/* Where points sit in a body: a linear operator from coefficients to displacements of points, by moving least squares
   over samples (stitched corners and element centres), eq. (30)-(32) with a window that is C2 at its edge.

   A sample's displacement is the mean of its elements' polynomials there:
     u(sample k) = sum over terms t of  1/terms(k) * sum_i term_basis[...] u_i(term_element[t])
   a point's is the weighted sum over its samples; the weights sum to one and reproduce linear fields. */
typedef struct dgfem_embedding {
    int sample_count;
    dgfem_vec3 *samples;       /* rest positions */
    int *term_start;           /* [sample_count + 1] */
    int *term_element;         /* element of each term */
    int *term_basis_start;     /* [terms + 1] into term_basis */
    dgfem_real *term_basis;    /* basis functions of the element at the sample */
    int point_count;
    dgfem_vec3 *points;        /* rest positions */
    int *point_element;        /* element that contains the point, or the nearest one */
    dgfem_vec3 *point_window;  /* where the samples' windows are evaluated: the point, or nearer to its element */
    int *weight_start;         /* [point_count + 1] */
    int *weight_sample;
    dgfem_real *weight;
    dgfem_real *sample_radius;  /* of the samples' windows; with the elements below for keeping weights later on */
    int element_count;
    dgfem_vec3 *element_centre;
    int *element_glue;          /* glued faces of each element */
    dgfem_vec3 *element_box;    /* [2 * element_count] lower and upper corners */
    int revision;              /* of the body it was made for */
    dgfem_hooks hooks;
} dgfem_embedding;

/* What holds or loads a body. Each condition has an id, under which it is moved or removed. */
typedef enum dgfem_condition_kind {
    DGFEM_CONDITION_FIX_FACES,    /* weak Dirichlet faces: displacement given */
    DGFEM_CONDITION_FIX_NORMAL,   /* symmetry faces: only the component along the rest normal is held, at zero */
    DGFEM_CONDITION_FIX_ELEMENTS, /* all unknowns of elements given, exactly */
    DGFEM_CONDITION_PIN,          /* a spring from a material point to a place */
    DGFEM_CONDITION_TRACTION,     /* force per area on boundary faces */
    DGFEM_CONDITION_PRESSURE,     /* normal pressure on boundary faces; turns with their elements */
    DGFEM_CONDITION_BODY_FORCE,   /* force per volume in elements */
    DGFEM_CONDITION_FORCE         /* force at a material point */
} dgfem_condition_kind;

typedef struct dgfem_condition {
    int id;
    dgfem_condition_kind kind;
    int count;                /* of items */
    int *items;               /* faces or elements, as the kind says */
    dgfem_vec3 vector;        /* displacement, place of a pin, traction, force density or force */
    dgfem_real scalar;        /* pressure, or stiffness of a pin (N/m) */
    dgfem_vec3 point;         /* rest position of a pin or force, in element items[0] */
    dgfem_displacement_fn fn; /* FIX_FACES: NULL where the displacement is `vector` */
    void *fn_user;
    dgfem_vec3 *values;       /* FIX_ELEMENTS: the coefficients of all items, one after the other */
} dgfem_condition;

typedef enum dgfem_shape_kind { DGFEM_SHAPE_PLANE, DGFEM_SHAPE_SPHERE } dgfem_shape_kind;

/* Something that a body touches. The contact is a stiff layer: pressure = modulus * depth with
   modulus = stiffness * (E / radius of the touched element), plus damping * modulus * approach speed. */
typedef struct dgfem_shape_desc {
    unsigned cookie;
    dgfem_plane plane;       /* plane: the body stays on the side that the normal points to */
    dgfem_vec3 centre;       /* sphere */
    dgfem_real radius;       /* sphere: > 0 the body stays outside, < 0 inside */
    dgfem_vec3 velocity;     /* of the shape, for friction and approach speed; it does not move by itself */
    dgfem_real stiffness;    /* dimensionless; default 10 */
    dgfem_real damping;      /* s; default 0.005 */
    dgfem_real friction;     /* Coulomb's coefficient; default 0.5 */
    dgfem_real slip_speed;   /* friction grows linearly up to this speed, m/s; default 1e-3 */
} dgfem_shape_desc;

typedef struct dgfem_shape {
    int id;
    dgfem_shape_kind kind;
    dgfem_shape_desc desc;
} dgfem_shape;

/* Signed distance of x from the shape, positive where a body may be, and the unit direction in which it grows. */
DGFEM_API dgfem_real dgfem_shape_distance(const dgfem_shape *shape, dgfem_vec3 x, dgfem_vec3 *normal);

typedef struct dgfem_forms dgfem_forms;     /* precomputed integrals, opaque */
typedef struct dgfem_contacts dgfem_contacts;
typedef struct dgfem_step_solver dgfem_step_solver;

/* State of a solid. Read freely; change only through functions.

   Element e has the polynomials ((x - origin[e]) / scale[e])^(i,j,k), i + j + k <= degree[e], in the order of
   dgfem_monomial_index, and as many coefficient vectors displacement[basis_start[e] + i] (3 numbers each). */
typedef struct dgfem_body {
    dgfem_mesh *mesh;
    dgfem_body_desc desc;
    int revision;              /* grows with every change of topology */
    int *degree;               /* [element_count] */
    dgfem_material *material;  /* [element_count] */
    dgfem_vec3 *origin;        /* [element_count] centre of the element's polynomials: its centroid */
    dgfem_real *scale;         /* [element_count] their length scale: its radius */
    int *basis_start;          /* [element_count + 1] */
    int basis_count;           /* sum over all elements; unknowns = 3 * basis_count */
    dgfem_vec3 *displacement;  /* [basis_count] coefficients */
    dgfem_vec3 *velocity;      /* [basis_count] coefficients */
    dgfem_vec3 *change;        /* [basis_count] of the velocity in the last step; zero before the first */
    dgfem_vec3 *force;         /* [basis_count] sum of tractions, forces and body forces; no gravity, no pressure */
    dgfem_mat3 *rotation;      /* [element_count] as of the last step or solve */
    int *family;               /* [element_count] or NULL: elements that refinement made of one have the same number; else DGFEM_NONE */
    int *family_parent;        /* [family_count] the number that the split element had */
    int family_count;
    int condition_count, condition_capacity, next_id;
    dgfem_condition *conditions;
    int shape_count, shape_capacity;
    dgfem_shape *shapes;
    double time;               /* sum of the steps */
    dgfem_forms *forms;
    dgfem_contacts *contacts;
    dgfem_matrix *matrix;
    dgfem_cholesky *cholesky;       /* NULL with sweeps and PCG, and with auto from a cut to the next factorization */
    dgfem_step_solver *step_solver; /* NULL with Cholesky and PCG */
    dgfem_real *work;
    dgfem_hooks hooks;
} dgfem_body;

DGFEM_API dgfem_body_desc dgfem_default_body_desc(void);
DGFEM_API dgfem_static_desc dgfem_default_static_desc(void);
DGFEM_API dgfem_shape_desc dgfem_default_shape_desc(void);

DGFEM_API dgfem_status dgfem_body_create(const dgfem_body_desc *desc, dgfem_body **out);
DGFEM_API void dgfem_body_destroy(dgfem_body *body);

/* Indices of all boundary faces whose vertices lie within `tolerance` of the plane (unit normal). Writes at most
   `capacity`; returns the number there are. */
DGFEM_API int dgfem_mesh_faces_on_plane(const dgfem_mesh *mesh, dgfem_plane plane, dgfem_real tolerance, int *faces,
                                        int capacity);

/* Conditions. *id (may be NULL) names the new one. A face or element can be held by one condition only.

   Faces are held weakly, by the same terms that glue elements: the displacement is met in the mean, and exactly by
   fields that the elements can represent. fn is sampled on the faces, once here and once in each resample_fixture;
   fields of the elements' degree are taken exactly. */
DGFEM_API dgfem_status dgfem_body_fix_faces(dgfem_body *body, const int *faces, int face_count, dgfem_vec3 displacement,
                                            int *id);
DGFEM_API dgfem_status dgfem_body_fix_faces_fn(dgfem_body *body, const int *faces, int face_count,
                                               dgfem_displacement_fn fn, void *user, int *id);
DGFEM_API dgfem_status dgfem_body_fix_normal(dgfem_body *body, const int *faces, int face_count, int *id);
DGFEM_API dgfem_status dgfem_body_move_fixture(dgfem_body *body, int id, dgfem_vec3 displacement);
DGFEM_API dgfem_status dgfem_body_resample_fixture(dgfem_body *body, int id);

/* Holds all unknowns of elements, exactly, at their current values; none may be given twice. move_elements gives them
   the affine displacement u(x) = translation + linear * x, reached at the end of the next step. */
DGFEM_API dgfem_status dgfem_body_fix_elements(dgfem_body *body, const int *elements, int element_count, int *id);
DGFEM_API dgfem_status dgfem_body_move_elements(dgfem_body *body, int id, dgfem_mat3 linear, dgfem_vec3 translation);

/* A spring (N/m) that pulls a material point of an element, given by its rest position, to where it is now; drag moves
   the place. */
DGFEM_API dgfem_status dgfem_body_pin(dgfem_body *body, int element, dgfem_vec3 rest, dgfem_real stiffness, int *id);
DGFEM_API dgfem_status dgfem_body_drag(dgfem_body *body, int id, dgfem_vec3 place);

/* Loads: traction (N/m^2), pressure (N/m^2, positive pushes inward), body force (N/m^3), force (N) at a material point
   of an element. */
DGFEM_API dgfem_status dgfem_body_set_traction(dgfem_body *body, const int *faces, int face_count, dgfem_vec3 traction,
                                               int *id);
DGFEM_API dgfem_status dgfem_body_set_pressure(dgfem_body *body, const int *faces, int face_count, dgfem_real pressure,
                                               int *id);
DGFEM_API dgfem_status dgfem_body_set_body_force(dgfem_body *body, const int *elements, int element_count,
                                                 dgfem_vec3 density, int *id);
DGFEM_API dgfem_status dgfem_body_add_force(dgfem_body *body, int element, dgfem_vec3 rest, dgfem_vec3 force, int *id);

DGFEM_API dgfem_status dgfem_body_remove_condition(dgfem_body *body, int id);

/* Contact shapes; *id (may be NULL) names it for dgfem_body_move_shape. */
DGFEM_API dgfem_status dgfem_body_add_plane(dgfem_body *body, const dgfem_shape_desc *desc, int *id);
DGFEM_API dgfem_status dgfem_body_add_sphere(dgfem_body *body, const dgfem_shape_desc *desc, int *id);
DGFEM_API dgfem_status dgfem_body_move_shape(dgfem_body *body, int id, const dgfem_shape_desc *desc);

/* The material points at which contact acts: rest positions and the area (m^2) that each stands for. Without this
   call they are the mesh's boundary corners. Call with count 0 to return to those. */
DGFEM_API dgfem_status dgfem_body_set_contact_points(dgfem_body *body, dgfem_points_in points, const dgfem_real *areas);

/* One step of semi-implicit Euler: (M + h D + h^2 K) v+ = M v + h (F - f(U)), U+ = U + h v+. On failure nothing has
   changed. info may be NULL. */
DGFEM_API dgfem_status dgfem_body_step(dgfem_body *body, dgfem_real dt, dgfem_step_info *info);

/* Static equilibrium of loads and fixtures (contact takes no part): with warping, repeated solves with new rotations.
   Velocities become zero. On failure the body stays as it was. DGFEM_ERROR_UNCONSTRAINED where the conditions leave a
   piece of the body free to move or turn as a rigid one. */
DGFEM_API dgfem_status dgfem_body_solve_static(dgfem_body *body, const dgfem_static_desc *desc, dgfem_step_info *info);

/* Changes the polynomial degree of one element, or of all ([element_count]). The state is kept exactly where the degree
   is raised and projected (L2, momentum kept) where it is lowered; integrals of what did not change are kept. Held
   faces keep their prescribed polynomial: call resample_fixture for more of a function. On failure nothing has changed. */
DGFEM_API dgfem_status dgfem_body_set_degree(dgfem_body *body, int element, int degree);
DGFEM_API dgfem_status dgfem_body_set_degrees(dgfem_body *body, const int *degrees);

/* ---- stability of the interior penalty ---- */

/* theta of an element: where eta > theta in all elements the stiffness is positive definite, whatever the elements'
   rotations. Usually below 3; grows with the number of differently oriented faces of an element. Sufficient, not
   necessary. Without meaning for BZ, which is stable for every eta. */
DGFEM_API dgfem_status dgfem_body_stability_bound(const dgfem_body *body, int element, dgfem_real *theta);

/* Sets the penalty factor of all faces. */
DGFEM_API dgfem_status dgfem_body_set_eta(dgfem_body *body, dgfem_real eta);

/* Doubles eta, ten times at most, until the unrotated stiffness can be factored, and returns what it is then. Where it
   had to be doubled, set twice that value before warping. DGFEM_ERROR_NOT_POSITIVE_DEFINITE leaves eta as it was. */
DGFEM_API dgfem_status dgfem_body_find_eta(dgfem_body *body, dgfem_real *eta);

/* ---- state of a body ---- */

/* Questions that cannot be answered (no such element or face, a position that is not finite) are logged and get zero,
   or for gradients and rotations the identity; without a body everything is zero. */

/* Displacement, velocity and deformation gradient of an element's polynomial at a rest position (inside or not). */
DGFEM_API dgfem_vec3 dgfem_body_displacement(const dgfem_body *body, int element, dgfem_vec3 rest);
DGFEM_API dgfem_vec3 dgfem_body_velocity(const dgfem_body *body, int element, dgfem_vec3 rest);
DGFEM_API dgfem_mat3 dgfem_body_gradient(const dgfem_body *body, int element, dgfem_vec3 rest); /* I + grad u */

/* Strain, and Cauchy stress (Pa), of the element's polynomial at a rest position, in world axes; both are taken in the
   element's rotated frame, so that rigid motion gives none. The mean_ functions give the means over the element. */
DGFEM_API dgfem_mat3 dgfem_body_strain(const dgfem_body *body, int element, dgfem_vec3 rest);
DGFEM_API dgfem_mat3 dgfem_body_stress(const dgfem_body *body, int element, dgfem_vec3 rest);
DGFEM_API dgfem_mat3 dgfem_body_mean_strain(const dgfem_body *body, int element);
DGFEM_API dgfem_mat3 dgfem_body_mean_stress(const dgfem_body *body, int element);

/* Principal stresses, ascending, and their unit directions (columns, right-handed; may be NULL), of the stress at a rest
   position and of an element's mean stress. */
DGFEM_API void dgfem_body_principal_stress(const dgfem_body *body, int element, dgfem_vec3 rest, dgfem_real values[3],
                                           dgfem_mat3 *directions);
DGFEM_API void dgfem_body_mean_principal_stress(const dgfem_body *body, int element, dgfem_real values[3],
                                                dgfem_mat3 *directions);

DGFEM_API dgfem_mat3 dgfem_body_rotation(const dgfem_body *body, int element);

/* Mean displacement over a face (both sides averaged). */
DGFEM_API dgfem_vec3 dgfem_body_face_displacement(const dgfem_body *body, int face);

/* Sets every coefficient so that the body has this displacement / velocity field; the field must be affine:
   value(x) = translation + linear * x. */
DGFEM_API dgfem_status dgfem_body_set_affine(dgfem_body *body, dgfem_mat3 linear, dgfem_vec3 translation);
DGFEM_API dgfem_status dgfem_body_set_affine_velocity(dgfem_body *body, dgfem_mat3 linear, dgfem_vec3 translation);

typedef struct dgfem_energy {
    dgfem_real kinetic;
    dgfem_real elastic; /* elements and glue, in rotated frames; held faces included, springs of pins not */
    dgfem_real gravity; /* potential - m g . x of all mass: zero for mass at the world's origin */
} dgfem_energy;

DGFEM_API dgfem_status dgfem_body_energy(const dgfem_body *body, dgfem_energy *out);

/* Linear momentum, and angular momentum about the world's origin; either may be NULL. */
DGFEM_API dgfem_status dgfem_body_momentum(const dgfem_body *body, dgfem_vec3 *linear, dgfem_vec3 *angular);
DGFEM_API dgfem_real dgfem_body_mass(const dgfem_body *body);

/* The consistent mass matrix of an element, int density N_i N_j, row-major; out[n * n] for an element of n basis
   functions. The body's is block diagonal: each entry stands for three equal ones, one per component. */
DGFEM_API dgfem_status dgfem_body_element_mass(const dgfem_body *body, int element, dgfem_real *out);


/* Deformed volume: sum of the elements' integrals of det F, exact for degree 1. */
DGFEM_API dgfem_real dgfem_body_volume(const dgfem_body *body);

/* Internal elastic force on every coefficient (what static equilibrium balances), for the current displacement:
   out[basis_count]. */
DGFEM_API dgfem_status dgfem_body_internal_force(const dgfem_body *body, dgfem_vec3 *out);

/* ---- embedding and skin -------------------------------------------------------------------------------------- */

/* MLS weights of rest positions in a body. Samples reach a point only through glued elements connected to it. */
DGFEM_API dgfem_status dgfem_embedding_create(const dgfem_body *body, dgfem_points_in points, dgfem_embedding **out);
DGFEM_API void dgfem_embedding_destroy(dgfem_embedding *embedding);

typedef struct dgfem_skin_desc {
    unsigned cookie;
    dgfem_points_in vertices; /* rest positions, in the caller's order, which is kept */
    const int *triangles;     /* three vertex indices each, or NULL: no normals */
    int triangle_count;
    dgfem_hooks hooks;
} dgfem_skin_desc;

typedef struct dgfem_skin {
    int vertex_count, triangle_count;
    dgfem_vec3 *positions; /* as of the last update */
    dgfem_vec3 *normals;   /* unit, angle-weighted; zero where no triangle has area */
    int *triangles;
    int *corner_start;     /* [vertex_count + 1] into corners; NULL without triangles, as normals and triangles */
    int *corners;          /* positions in `triangles` at which each vertex appears */

    /* What cuts have changed. Vertices keep their index, new ones are appended; a triangle that was split leaves one
       part in its place, the other parts and the walls of the cut are appended; of a tiny one on an earlier wall nothing
       may be left. The arrays are NULL before the first. */
    int original_vertex_count, original_triangle_count; /* as created */
    int cut_count;
    int *parents;              /* two of each new vertex, of lower index, that any attribute can be had from: */
    dgfem_real *parent_weight; /* (1 - weight) * first + weight * second; DGFEM_NONE inside walls: none */
    int *source;               /* [triangle_count] original triangle; DGFEM_NONE for walls */
    int *wall;                 /* [triangle_count] 0; +k, -k: a wall of cut k >= 1 on the side of its normal, or behind */
    int *weld;                 /* [vertex_count] lowest vertex at the same point of the surface: closed in these,
                                  but where strokes through a moving body did not quite meet */
    dgfem_vec3 *anchors;       /* [vertex_count] rest position inside the material that a vertex belongs to */

    dgfem_embedding *embedding;
    dgfem_vec3 *sample_displacement;
    dgfem_hooks hooks;
} dgfem_skin;

DGFEM_API dgfem_skin_desc dgfem_default_skin_desc(void);
DGFEM_API dgfem_status dgfem_skin_create(const dgfem_body *body, const dgfem_skin_desc *desc, dgfem_skin **out);
DGFEM_API void dgfem_skin_destroy(dgfem_skin *skin);

/* New weights after the body's topology has changed in another way than by a cut: refined, merged, other degrees.
   Vertices and triangles stay. On failure nothing has changed. */
DGFEM_API dgfem_status dgfem_skin_renew(dgfem_skin *skin, const dgfem_body *body);

/* Moves the skin with the body; nothing is allocated. DGFEM_ERROR_REVISION when the body's topology has changed. */
DGFEM_API dgfem_status dgfem_skin_update(dgfem_skin *skin, const dgfem_body *body);

/* Copies the result into the caller's (strided) buffers, in the caller's vertex order. */
DGFEM_API dgfem_status dgfem_skin_positions(const dgfem_skin *skin, dgfem_points_out out);
DGFEM_API dgfem_status dgfem_skin_normals(const dgfem_skin *skin, dgfem_points_out out);

/* The exact boundary of the elements as triangles: boundary faces, and cut faces once for each side. Watertight where
   elements are glued, open where they are cut. A vertex stands at the mean of its elements' polynomials, eq. (30).
   Between walls and the outside, and where faces meet by more than 60 degrees at rest, edges are sharp: each side has
   vertices of its own, at the same place. */
typedef struct dgfem_surface {
    int vertex_count, triangle_count;
    dgfem_vec3 *positions; /* as of the last update */
    dgfem_vec3 *normals;   /* unit, angle-weighted; zero where no triangle has area */
    int *triangles;        /* three vertices each, counter-clockwise from outside */
    int *element;          /* [triangle_count] */
    int *face;             /* [triangle_count] of the mesh */
    int *source;           /* [triangle_count] tag of that face */
    int *wall;             /* [triangle_count] 1: a cut face, or a boundary face without tag where others have one */
    int *corner_start;     /* [vertex_count + 1] into corners */
    int *corners;          /* positions in `triangles` at which each vertex appears */
    int *sample;           /* [vertex_count] sample of the embedding; vertices that share one stay together */
    dgfem_embedding *embedding; /* its samples are the corners; it has no points */
    dgfem_vec3 *sample_displacement;
    dgfem_hooks hooks;
} dgfem_surface;

DGFEM_API dgfem_status dgfem_surface_create(const dgfem_body *body, dgfem_surface **out);
DGFEM_API void dgfem_surface_destroy(dgfem_surface *surface);

/* Moves the surface with the body; nothing is allocated. DGFEM_ERROR_REVISION when the body's topology has changed:
   make a new one then. */
DGFEM_API dgfem_status dgfem_surface_update(dgfem_surface *surface, const dgfem_body *body);

/* Copies the result into the caller's (strided) buffers. */
DGFEM_API dgfem_status dgfem_surface_positions(const dgfem_surface *surface, dgfem_points_out out);
DGFEM_API dgfem_status dgfem_surface_normals(const dgfem_surface *surface, dgfem_points_out out);

/* ---- cutting ------------------------------------------------------------------------------------------------- */

/* Told of each piece that has come off: `piece` as dgfem_body_pieces numbers it, and its elements. Of what hung together
   before, the largest part is not new. Called at the end, when all is done; the body must not be changed in it. */
typedef void (*dgfem_new_piece_fn)(void *user, const dgfem_body *body, int piece, const int *elements,
                                   int element_count);

/* A cut opens because the glue between elements is gone, nothing else: the field stays as it is, elements that the blade
   passes are split and both parts keep their polynomial. Materials, tags, conditions and loads stay on the parts. Blades
   are given in world space and meet the body as it is now. On failure nothing has changed; a cut that succeeds raises
   the body's revision. */
typedef struct dgfem_cut_desc {
    unsigned cookie;
    dgfem_real snap;     /* an element of which less than this times its radius lies beyond the blade stays whole; default 1e-3 */
    dgfem_real sliver;   /* a part below this times its largest neighbour, in volume or (cubed) thickness, is merged into one
                            that it is glued to; one that would come off alone is not cut off; 0: neither; default 1e-3 */
    dgfem_real smallest; /* the same as a length (m): parts thinner than this, across the blade or as volume over largest
                            face; default 0 */
    dgfem_skin *const *skins; /* render meshes, up to date with the body, that are cut along with it; or NULL */
    int skin_count;
    dgfem_new_piece_fn new_piece; /* or NULL */
    void *new_piece_user;
} dgfem_cut_desc;

typedef struct dgfem_cut_info {
    int elements_split;
    int faces_cut;      /* that were glued; 0: the blade missed, and nothing has changed */
    int slivers_merged;
} dgfem_cut_info;

DGFEM_API dgfem_cut_desc dgfem_default_cut_desc(void);

/* Cuts along a whole plane. desc (NULL: the default) and info may be NULL. */
DGFEM_API dgfem_status dgfem_body_cut_plane(dgfem_body *body, dgfem_plane plane, const dgfem_cut_desc *desc,
                                            dgfem_cut_info *info);

/* Cuts inside a planar polygon, convex or not, in either sense. Elements that it meets are split along its plane, and
   their parts stay glued outside of it. Refuses polygons of fewer than three vertices, without area, bent or crossing themselves. */
DGFEM_API dgfem_status dgfem_body_cut_polygon(dgfem_body *body, dgfem_points_in polygon, const dgfem_cut_desc *desc,
                                              dgfem_cut_info *info);

/* Cuts along triangles (three vertex indices each, in either sense), one after the other: a surface, or the area that a
   moving edge has swept. Triangles without area, or thinner than 1e-12 (float: 1e-4) of their length, cut nothing: wait
   until a slow edge has moved. Where elements jump or bend, the surface is followed as closely as their neighbours
   agree on where it is. */
DGFEM_API dgfem_status dgfem_body_cut_surface(dgfem_body *body, dgfem_points_in vertices, const int *triangles,
                                              int triangle_count, const dgfem_cut_desc *desc, dgfem_cut_info *info);

/* A connected part of a body: elements held together by glue. */
typedef struct dgfem_piece {
    int element_count;
    dgfem_real volume; /* at rest, m^3 */
    dgfem_real mass;
    dgfem_vec3 centre;   /* of mass, in the world */
    dgfem_vec3 momentum; /* kg m/s */
    dgfem_vec3 spin;     /* angular momentum about the centre of mass, kg m^2/s */
} dgfem_piece;

/* Numbers the pieces in the order of their first elements: piece_of[element_count] (may be NULL) receives the piece of
   each element, pieces (may be NULL) the first `capacity` of them, *count their number. */
DGFEM_API dgfem_status dgfem_body_pieces(const dgfem_body *body, int *piece_of, dgfem_piece *pieces, int capacity,
                                         int *count);

/* ---- refining, coarsening, breaking -------------------------------------------------------------------------- */

/* What is to become of an element. Splitting and raising leave the field as it is; merging and lowering project it (L2),
   which keeps momentum, and leaves it as it is where the result can represent it. */
typedef enum dgfem_refine_action {
    DGFEM_REFINE_NONE,
    DGFEM_REFINE_EIGHT, /* split by three planes through the centroid, half way between opposite sides; what is not a
                           hexahedron, by DGFEM_REFINE_TWO. Sides that smaller neighbours have divided count as whole */
    DGFEM_REFINE_TWO,   /* split by the plane through the centroid across the principal stress of largest magnitude */
    DGFEM_REFINE_RAISE, /* degree + 1 */
    DGFEM_REFINE_LOWER, /* degree - 1 */
    DGFEM_REFINE_MERGE  /* undo a split: done where all elements that came of it are to be merged, none has been split
                           again, none is held, and their degree, material and conditions are the same. What is cut
                           stays apart */
} dgfem_refine_action;

typedef struct dgfem_refine_desc {
    unsigned cookie;
    dgfem_refine_action how;  /* EIGHT (default), TWO or RAISE: for elements whose stress is above `refine_above`, */
    dgfem_real refine_above;  /* Pa: the largest magnitude among the principal stresses of the element's mean stress;
                                 default infinity: none */
    dgfem_real merge_below;   /* Pa: elements below are merged (how RAISE: lowered); at most refine_above; default 0: none */
    dgfem_real smallest;      /* m: elements whose parts' mean volume would be below its cube stay whole; default 0 */
    int highest_degree;       /* RAISE goes no further; default 3 */
    int lowest_degree;        /* nor LOWER; default 1 */
    dgfem_refine_action (*choose)(void *user, const dgfem_body *body, int element, dgfem_refine_action proposed);
                              /* NULL, or decides instead; proposed: what the stress says */
    void *user;
} dgfem_refine_desc;

typedef struct dgfem_refine_info {
    int elements_split;       /* that became several */
    int elements_merged;      /* that vanished into another */
    int degrees_raised, degrees_lowered;
    dgfem_real largest_stress; /* of all elements before the call, Pa */
} dgfem_refine_info;

DGFEM_API dgfem_refine_desc dgfem_default_refine_desc(void);

/* One round: no element is split twice. Neighbours may differ by any number of splits. Materials, tags, conditions and
   loads stay where they are. body->family remembers what was split. A round that does nothing leaves the revision as it
   is; on failure nothing has changed. info may be NULL. */
DGFEM_API dgfem_status dgfem_body_refine(dgfem_body *body, const dgfem_refine_desc *desc, dgfem_refine_info *info);

/* Merges every element below `ratio` times its largest glued neighbour, in volume or (cubed) thickness, 0 <= ratio < 1,
   into the neighbour with which it shares the largest glued area and no cut face; material, degree and conditions of both
   must be the same. The union's field is the L2 projection. *merged (may be NULL) counts the elements that vanished; 0:
   nothing has changed. */
DGFEM_API dgfem_status dgfem_body_merge_slivers(dgfem_body *body, dgfem_real ratio, int *merged);

typedef struct dgfem_fracture_desc {
    unsigned cookie;
    dgfem_real strength;         /* > 0, Pa: normal traction at which glue breaks; default infinity: never */
    const dgfem_real *strengths; /* [element_count] or NULL: `strength` everywhere. Between two elements the weaker counts */
    dgfem_real toughness;        /* J/m^2: energy that a new crack costs per area; default 0 */
    int split;                   /* 1: elements may break inside; default 0 */
    dgfem_real smallest;         /* m: elements whose parts' mean volume would be below its cube do not; default 0 */
    dgfem_real sliver;           /* as in dgfem_cut_desc, for the parts of elements that were split; default 1e-3 */
    int max_breaks;              /* per call; default INT_MAX */
} dgfem_fracture_desc;

typedef struct dgfem_fracture_info {
    int faces_broken;         /* new faces inside elements included */
    int elements_split;
    int slivers_merged;
    dgfem_real largest_ratio; /* of normal traction to strength, over all glued faces, before the call */
} dgfem_fracture_info;

DGFEM_API dgfem_fracture_desc dgfem_default_fracture_desc(void);

/* Breaks the glue of faces between elements where the peak normal traction reaches the strength; those first where it
   exceeds it most, at most max_breaks. The traction is the mean of both sides' stresses, each turned with its element, on
   the face's normal in the world; the peak is the largest of its values at the face's vertices and centre. Compression
   and shear alone break nothing.

   With a toughness G > 0 the face must also release enough energy: the part of the two elements' energy that its
   traction (t_n normal, t_s along it, at the centre) does, if it were uniaxial, per area,
     sum over both sides of (t_n^2 / 2E + t_s^2 / 2mu) * (volume / area of the element's side),   at least G.

   With `split`, an element whose largest principal stress (mean, tensile) reaches its strength, but of whose faces none
   breaks, is split by the plane through its centroid across that stress, and the new face breaks; the energy is that of
   the whole element.

   Call it after each step; cracks advance by one element a call, stress having found its new way in between. A call that
   breaks nothing leaves the revision as it is; on failure nothing has changed. info may be NULL. */
DGFEM_API dgfem_status dgfem_body_fracture(dgfem_body *body, const dgfem_fracture_desc *desc, dgfem_fracture_info *info);
