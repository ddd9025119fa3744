/* dgfem.h - deformable solids by discontinuous Galerkin finite elements on arbitrary polyhedra

   A single-header library in C99 (also C++). It cuts a closed triangle surface into polyhedra with a hexahedral grid,
   moves them as one elastic body, and carries the original surface along as a smooth skin. It needs libc and libm,
   nothing else: no build system, no threads of its own, no global state.

   The method is that of P. Kaufmann, S. Martin, M. Botsch, M. Gross, "Flexible simulation of deformable models using
   discontinuous Galerkin FEM" (2009), with corrections. Equation numbers in comments refer to that paper.


   HOW TO BUILD IT IN

   In exactly one C or C++ file:

       #define DGFEM_IMPLEMENTATION
       #include "dgfem.h"

   and everywhere else only #include "dgfem.h". Link with -lm where that is a library of its own.


   CONFIGURATION

   Define these before the #include, the same in every file that includes it; all are optional.

       DGFEM_IMPLEMENTATION   compiles the function bodies here; in one file only
       DGFEM_REAL             float or double, the type behind dgfem_real; default double. The two do not link together.
       DGFEM_STATIC           all functions are static: the library is private to the one file that implements it
       DGFEM_API              what stands before each public function; default extern (extern "C" in C++), or static
       DGFEM_ASSERT(x)        checks of internal invariants; default assert(x), so NDEBUG takes them away

   No function prints, aborts or exits. Memory, log, threads and clock come in through dgfem_hooks, a member of each
   descriptor; all zero means libc's allocator, silence, one thread, no clock.


   HOW IT IS USED

   Every creating function takes a descriptor and returns a dgfem_status:

       dgfem_grid_desc desc = dgfem_default_grid_desc();   fills in every member, and a mark that this was done
       desc.cells[0] = 8;                                   change what should differ
       dgfem_status status = dgfem_mesh_create_grid(&desc, &mesh);
       if (status != DGFEM_OK) puts(dgfem_status_text(status));

   Zero always means zero, never "default". DGFEM_OK is 0. A call that fails has changed nothing, has freed what it
   took, and has logged one line that names the offender (face, edge, vertex, member). Structs may be read freely and
   are changed through functions. What was created is destroyed by the function of that name; destroying NULL is fine.

   From triangles to motion:

       dgfem_mesh_create_slices     a closed surface and a grid        -> a mesh of polyhedra
       dgfem_body_create            a mesh and a material              -> a body (which takes the mesh over)
       dgfem_body_fix_faces, _add_plane, _add_sphere, _set_traction    what holds it, what it touches, what pulls
       dgfem_skin_create            a body and the surface's vertices  -> a skin
       dgfem_body_step              advances the body, once a frame or several times
       dgfem_skin_update            moves the skin along; dgfem_skin_positions copies it into your vertex buffer

   The building blocks are public too: polyhedra with exact integrals of all monomials up to degree 6, plane splits,
   a symmetric block matrix with a sparse Cholesky factorization and conjugate gradients, polar rotations, symmetric
   eigenvectors.


   A WHOLE PROGRAM

       #define DGFEM_IMPLEMENTATION
       #include "dgfem.h"
       #include <stdio.h>

       int main(void) {
           // An octahedron of 1 m radius: six vertices, eight triangles, counter-clockwise from outside.
           const double vertices[] = {1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1};
           const int triangles[] = {0, 2, 4, 2, 1, 4, 1, 3, 4, 3, 0, 4, 2, 0, 5, 1, 2, 5, 3, 1, 5, 0, 3, 5};
           float positions[18];

           // 1. Cut it into polyhedra: 4 cubic cells along each axis.
           dgfem_slice_desc slices = dgfem_default_slice_desc();
           slices.vertices = dgfem_points_in_double(vertices, 6);
           slices.triangles = triangles;
           slices.triangle_count = 8;
           slices.cells = 4;
           dgfem_mesh *mesh;
           dgfem_status status = dgfem_mesh_create_slices(&slices, &mesh);
           if (status) return puts(dgfem_status_text(status)), 1;

           // 2. Make it a body of soft rubber. From here on the body owns the mesh.
           dgfem_body_desc desc = dgfem_default_body_desc();
           desc.mesh = mesh;
           desc.material.young = DGFEM_R(2e5);
           desc.material.poisson = DGFEM_R(0.4);
           desc.damping_stiffness = DGFEM_R(0.01);
           dgfem_body *body;
           if (dgfem_body_create(&desc, &body)) return dgfem_mesh_destroy(mesh), 1;

           // 3. Put a floor under it, 2 m below its centre.
           dgfem_shape_desc floor_desc = dgfem_default_shape_desc();
           floor_desc.plane.normal.z = 1;
           floor_desc.plane.offset = -2;
           if (dgfem_body_add_plane(body, &floor_desc, NULL)) return 1;

           // 4. Let its surface follow as a skin.
           dgfem_skin_desc skin_desc = dgfem_default_skin_desc();
           skin_desc.vertices = slices.vertices;
           skin_desc.triangles = triangles;
           skin_desc.triangle_count = 8;
           dgfem_skin *skin;
           if (dgfem_skin_create(body, &skin_desc, &skin)) return 1;

           // 5. Two seconds, sixty frames each.
           for (int frame = 1; frame <= 120; frame++) {
               if (dgfem_body_step(body, DGFEM_R(1) / 60, NULL)) return 1;
               if (dgfem_skin_update(skin, body)) return 1;
               if (dgfem_skin_positions(skin, dgfem_points_out_float(positions, 6))) return 1;
               if (frame % 30 == 0) printf("%3.1f s: lowest vertex at z = %.1f\n", body->time, (double)positions[17]);
           }
           dgfem_skin_destroy(skin);
           dgfem_body_destroy(body);
           return 0;
       }


   WHAT IT DOES NOT DO

   - Materials other than isotropic linear ones. Large rotations are followed (stiffness warping, one rotation per
     element); the law between strain and stress is linear, so that large strains are plausible rather than accurate.
   - Contact between bodies or of a body with itself. Contact shapes are planes and spheres, by penalty: things sink
     in a little, in proportion to their weight.
   - Repairing surfaces. Open, inside-out or degenerate ones are refused with the offender named. A surface that crosses
     itself is not noticed.
   - Hard constraints. Fixed faces are held weakly, by the same terms that glue elements together: exactly in the
     mean as the mesh is refined, with a small residue on coarse ones.
   - Reading or writing files, drawing, threads of its own.
   - Calls on the same object from two threads at once. Different objects are independent.


   NUMERIC LIMITS

   - Units are yours, if consistent; the comments use SI. Geometry is measured about each element's own centre, so that
     an object far from the origin loses only what storing its coordinates loses: at a distance of 10^k times its size
     k of some sixteen decimal digits in double, of some seven in float.
   - Moments (dgfem_polyhedron_moments) are exact but for round-off of about 1e-15 h^d V (float: 1e-6 h^d V) about a
     centre close to the polyhedron; h is its radius, V its volume, d the degree. About a far centre they lose digits by
     their nature.
   - Cells of the slicing grid may be much larger or smaller than the triangles. Slivers smaller than 1e-3 of a cell
     are merged by default; with `sliver` 0 they stay, and cost accuracy of the linear solver, not correctness.
   - Elements may be flat or stretched, by 1:100 and more; the condition of the matrix grows with the stretch.
   - Poisson's ratio: -1 < nu < 0.5. The default penalty does not lock at 0.499; loads that change the volume of a
     nearly incompressible body are answered with an error that grows like lambda/mu h^2.
   - One layer of elements of degree 1 bends 40 to 65 % too softly with the default eta_rest 0.5; two layers or degree 2
     are good, or eta_rest = (1 + nu) / 2.
   - The system of a time step is positive definite for any dt > 0. Implicit Euler damps: a motion of angular frequency
     w loses about dt w^2 / 2 of its amplitude per unit of time.
   - dgfem_body_solve_static repeats linear solves with new rotations. It stops with DGFEM_ERROR_NOT_CONVERGED for
     loads that turn the tip of a beam by more than some 80 degrees: use load steps, or damped time steps.
   - With warping, linear momentum is kept but for round-off, angular momentum only nearly.
   - Counts and indices are int. Memory grows with the number of elements, that of the Cholesky factor faster;
     DGFEM_SOLVER_PCG needs no factor.
   - In float, tolerances are as documented at each function; prefer double for degree 2 and 3 and for static solves.


   LICENCE

   MIT; the text stands at the end of this file. */

/* Contents, in the order of dependency; search for "== name".

   api.h              Public types and declarations.
   base.c             Status texts, allocation, growable arrays, log, parallel-for, strided points.
   linalg.c           Small dense algebra: vectors, 3x3 matrices, polar rotation, symmetric eigenvectors, dense
                      Cholesky.
   planar.c           Planar regions bounded by loops: which side of a line, simplicity, triangles.
   moments.c          Integrals of all monomials over polyhedra and planar polygons, from signed tetrahedra and
                      triangles.
   polyhedron.c       The stand-alone polyhedron: creation, check, measure, contains, moments, triangles of its faces,
                      components.
   mesh.c             The cell complex: storage, measures, compacting, copies, queries, edges.
   corners.c          Corners: classes of (vertex, element) pairs connected through glued faces around the vertex, by
                      union-find.
   mesh_build.c       Meshes from boxes, tetrahedra and polyhedra; an element as a polyhedron.
   mesh_check.c       dgfem_mesh_check: every invariant of the cell complex.
   mesh_merge.c       dgfem_mesh_merge_slivers: small elements vanish into a neighbour.
   parts.c            Components, connected over edges, of a set of oriented faces; voids find the component that
                      encloses them.
   join.c             Directed edges in a plane -> closed loops -> regions, each one outer loop with its holes.
   split_face.c       Plane split, first half: the splitter, crossing vertices, cutting a face.
   split.c            Plane split of elements of the cell complex; the stand-alone polyhedron is split as a complex of
                      one element.
   slice.c            Closed triangle surface x hexahedral grid -> mesh.
   basis.c            The polynomial basis of an element: centred, scaled monomials ((x - c)/s)^(i,j,k), i + j + k <=
                      degree.
   forms.c            The integrals behind the weak form, from moments alone, in the unrotated material.
   sparse.c           Symmetric matrix in dense blocks of any sizes.
   ordering.c         Fill-reducing orderings of the blocks: minimum degree and geometric nested dissection.
   panel.c            Dense kernels of the sparse Cholesky factorization.
   cholesky.c         Sparse Cholesky factorization A = L L^T of matrices in blocks: symbolic analysis, multifrontal
                      factorization, solves.
   pcg.c              Conjugate gradients, preconditioned by the inverse diagonal blocks.
   locate.c           Which element of a mesh contains a point, or is nearest to it: winding numbers of elements,
                      distances of faces, and buckets of element boxes that keep the search short.
   embed.c            Embedding of points in a body by moving least squares (MLS), eq.
   contact.c          Penalty contact and friction of embedded points against planes and spheres, implicit in the
                      step's velocities.
   warp.c             Stiffness warping: rotations of the elements, and the warped system assembled from the forms.
   body.c             State of a solid: descriptors, creation, the block system and its solver.
   load.c             What acts on a solid: conditions (held faces and elements, pins, loads), contact shapes and
                      points.
   solve.c            Moving a solid: the time step and the static solve.
   stability.c        How large the penalty must be: a bound per element that guarantees a positive definite stiffness
                      for any rotations of the elements, and a search by factorization.
   query.c            Asking a solid: fields at a point, energies, momenta, volume, internal force; setting affine
                      fields.
   degree.c           Changing the polynomial degree of elements while the body lives: coefficients are kept exactly
                      when the degree is raised and L2-projected when it is lowered; integrals of what did not change
                      are kept.
   skin.c             A render mesh that follows a body: positions by embedding, normals from its own triangles. */

#ifndef DGFEM_H
#define DGFEM_H

/* ==== api.h ======================================================================================================= */

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
   singular to have one (sigma_2 + sigma_3 < 1e-6 sigma_1), `fallback` is returned (pass the last rotation). */
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

typedef struct dgfem_matrix {
    int block_count;
    int size;             /* number of unknowns */
    int *offset;          /* [block_count + 1] first unknown of each block */
    int *row_start;       /* [block_count + 1] */
    int *column;          /* of row r, ascending: row_start[r] <= k < row_start[r + 1]; the last one is r itself */
    size_t *value_start;  /* [row_start[block_count] + 1] block k: row-major, size(r) x size(column[k]) */
    dgfem_real *values;
    dgfem_vec3 *centres;  /* [block_count] or NULL */
    dgfem_hooks hooks;
} dgfem_matrix;

DGFEM_API dgfem_matrix_desc dgfem_default_matrix_desc(void);
DGFEM_API dgfem_status dgfem_matrix_create(const dgfem_matrix_desc *desc, dgfem_matrix **out); /* all values zero */
DGFEM_API void dgfem_matrix_destroy(dgfem_matrix *matrix);
DGFEM_API void dgfem_matrix_clear(dgfem_matrix *matrix);

/* The stored block (row >= column), row-major, to be read or written in place; NULL where there is none. Diagonal
   blocks are stored whole and must be symmetric (the factorization reads their lower half only). */
DGFEM_API dgfem_real *dgfem_matrix_block(const dgfem_matrix *matrix, int row, int column);

/* y = A x; x and y are different vectors of matrix->size. */
DGFEM_API void dgfem_matrix_multiply(const dgfem_matrix *matrix, const dgfem_real *x, dgfem_real *y);

typedef enum dgfem_ordering {
    DGFEM_ORDERING_AUTO,              /* nested dissection or, without centres or if that is better, minimum degree */
    DGFEM_ORDERING_NATURAL,
    DGFEM_ORDERING_MINIMUM_DEGREE,
    DGFEM_ORDERING_NESTED_DISSECTION  /* needs the matrix's centres */
} dgfem_ordering;

typedef struct dgfem_cholesky_desc {
    unsigned cookie;
    dgfem_ordering ordering;
    dgfem_hooks hooks;
} dgfem_cholesky_desc;

/* Opaque: A = L L^T under a fill-reducing permutation of the blocks. */
typedef struct dgfem_cholesky dgfem_cholesky;

typedef struct dgfem_cholesky_info {
    int failed_block;         /* the block whose pivot was not positive, or DGFEM_NONE */
    double factor_entries;    /* numbers in L, without the zeros that are stored with them */
    double factor_flops;      /* multiplications and additions of one factorization, without those on such zeros */
    int supernodes;           /* dense panels that L is stored in */
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
    DGFEM_PENALTY_SPLIT,  /* stiff on the jump's projection to degree p-1, soft (shear modulus) on the rest: no locking */
    DGFEM_PENALTY_TENSOR, /* mu I + (lambda + mu) n n^T on the whole jump */
    DGFEM_PENALTY_SCALAR  /* (lambda + 2 mu) on the whole jump, as the paper; locks for p = 1 */
} dgfem_penalty;

typedef enum dgfem_solver { DGFEM_SOLVER_CHOLESKY, DGFEM_SOLVER_PCG } dgfem_solver;

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
    dgfem_real damping_stiffness;    /* Rayleigh beta, s; default 0 */
    int warp;                        /* 1: stiffness warping (default); 0: linear elasticity */
    dgfem_solver solver;             /* default Cholesky */
    dgfem_real solver_tolerance;     /* of PCG; default 1e-6 (float: 1e-4) */
    int solver_iterations;           /* of PCG at most; default 1000 */
    dgfem_hooks hooks;
} dgfem_body_desc;

typedef struct dgfem_step_info {
    int iterations;           /* of PCG; 0 with Cholesky */
    int sweeps;               /* static solve: solves with new rotations */
    int contacts;             /* contact points that were active */
    int failed_element;       /* whose pivot was not positive, or DGFEM_NONE */
    dgfem_real residual;      /* of PCG; static solve: last relative change of the displacement */
    double seconds_assemble, seconds_contact, seconds_factor, seconds_solve; /* 0 without a clock */
} dgfem_step_info;

/* A prescribed displacement: fills in *displacement at a material (rest) position. */
typedef void (*dgfem_displacement_fn)(void *user, dgfem_vec3 rest, dgfem_vec3 *displacement);

typedef struct dgfem_static_desc {
    unsigned cookie;
    int load_steps;         /* default 1 */
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
    int *weight_start;         /* [point_count + 1] */
    int *weight_sample;
    dgfem_real *weight;
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

typedef struct dgfem_forms dgfem_forms;     /* precomputed integrals, opaque */
typedef struct dgfem_contacts dgfem_contacts;

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
    dgfem_vec3 *force;         /* [basis_count] sum of tractions, forces and body forces; without gravity and pressure */
    dgfem_mat3 *rotation;      /* [element_count] as of the last step or solve */
    int condition_count, condition_capacity, next_id;
    dgfem_condition *conditions;
    int shape_count, shape_capacity;
    dgfem_shape *shapes;
    double time;               /* sum of the steps */
    dgfem_forms *forms;
    dgfem_contacts *contacts;
    dgfem_matrix *matrix;
    dgfem_cholesky *cholesky;
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

/* Holds all unknowns of elements, exactly, at their current values; move_elements gives them the affine displacement
   u(x) = translation + linear * x, reached at the end of the next step. */
DGFEM_API dgfem_status dgfem_body_fix_elements(dgfem_body *body, const int *elements, int element_count, int *id);
DGFEM_API dgfem_status dgfem_body_move_elements(dgfem_body *body, int id, dgfem_mat3 linear, dgfem_vec3 translation);

/* A spring (N/m) that pulls a material point of an element, given by its rest position, to where it is now; drag moves
   the place. */
DGFEM_API dgfem_status dgfem_body_pin(dgfem_body *body, int element, dgfem_vec3 rest, dgfem_real stiffness, int *id);
DGFEM_API dgfem_status dgfem_body_drag(dgfem_body *body, int id, dgfem_vec3 place);

/* Loads: traction (N/m^2), pressure (N/m^2, positive pushes inward), body force (N/m^3), force (N) at a material point. */
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
   Velocities become zero. DGFEM_ERROR_NOT_CONVERGED leaves the body as it was. */
DGFEM_API dgfem_status dgfem_body_solve_static(dgfem_body *body, const dgfem_static_desc *desc, dgfem_step_info *info);

/* Changes the polynomial degree of one element, or of all ([element_count]). The state is kept exactly where the degree
   is raised and projected (L2, momentum kept) where it is lowered; integrals of what did not change are kept. Held faces
   keep their prescribed polynomial: call resample_fixture for more of a function. On failure nothing has changed. */
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

/* Displacement, velocity and deformation gradient of an element's polynomial at a rest position (inside or not). */
DGFEM_API dgfem_vec3 dgfem_body_displacement(const dgfem_body *body, int element, dgfem_vec3 rest);
DGFEM_API dgfem_vec3 dgfem_body_velocity(const dgfem_body *body, int element, dgfem_vec3 rest);
DGFEM_API dgfem_mat3 dgfem_body_gradient(const dgfem_body *body, int element, dgfem_vec3 rest); /* I + grad u */

/* Cauchy stress (Pa, world axes) of the element's polynomial at a rest position; strain is taken in the element's
   rotated frame, so that rigid motion gives none. */
DGFEM_API dgfem_mat3 dgfem_body_stress(const dgfem_body *body, int element, dgfem_vec3 rest);

DGFEM_API dgfem_mat3 dgfem_body_rotation(const dgfem_body *body, int element);

/* Mean displacement over a face (both sides averaged). */
DGFEM_API dgfem_vec3 dgfem_body_face_displacement(const dgfem_body *body, int face);

/* Sets every coefficient so that the body has this displacement / velocity field; the field must be affine:
   value(x) = translation + linear * x. */
DGFEM_API dgfem_status dgfem_body_set_affine(dgfem_body *body, dgfem_mat3 linear, dgfem_vec3 translation);
DGFEM_API dgfem_status dgfem_body_set_affine_velocity(dgfem_body *body, dgfem_mat3 linear, dgfem_vec3 translation);

typedef struct dgfem_energy {
    dgfem_real kinetic;
    dgfem_real elastic; /* elements and glue, in rotated frames; fixtures included */
    dgfem_real gravity; /* potential, zero at the rest position's origin */
} dgfem_energy;

DGFEM_API dgfem_status dgfem_body_energy(const dgfem_body *body, dgfem_energy *out);
DGFEM_API dgfem_status dgfem_body_momentum(const dgfem_body *body, dgfem_vec3 *linear, dgfem_vec3 *angular);
DGFEM_API dgfem_real dgfem_body_mass(const dgfem_body *body);
DGFEM_API dgfem_real dgfem_body_volume(const dgfem_body *body); /* deformed: sum over elements of integral det F, p = 1 exact */

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
    dgfem_embedding *embedding;
    dgfem_vec3 *sample_displacement;
    dgfem_hooks hooks;
} dgfem_skin;

DGFEM_API dgfem_skin_desc dgfem_default_skin_desc(void);
DGFEM_API dgfem_status dgfem_skin_create(const dgfem_body *body, const dgfem_skin_desc *desc, dgfem_skin **out);
DGFEM_API void dgfem_skin_destroy(dgfem_skin *skin);

/* Moves the skin with the body; nothing is allocated. DGFEM_ERROR_REVISION when the body's topology has changed. */
DGFEM_API dgfem_status dgfem_skin_update(dgfem_skin *skin, const dgfem_body *body);

/* Copies the result into the caller's (strided) buffers, in the caller's vertex order. */
DGFEM_API dgfem_status dgfem_skin_positions(const dgfem_skin *skin, dgfem_points_out out);
DGFEM_API dgfem_status dgfem_skin_normals(const dgfem_skin *skin, dgfem_points_out out);

#endif /* DGFEM_H */

#if defined(DGFEM_IMPLEMENTATION) && !defined(DGFEM_IMPLEMENTED)
#define DGFEM_IMPLEMENTED

/* ==== base.c ====================================================================================================== */

/* Status texts, allocation, growable arrays, log, parallel-for, strided points. */

#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifndef DGFEM_ASSERT
#include <assert.h>
#define DGFEM_ASSERT(condition) assert(condition)
#endif

#if defined(__GNUC__) || defined(__clang__)
#define DGFEM_PRINTF(format_index, first) __attribute__((format(printf, format_index, first)))
#else
#define DGFEM_PRINTF(format_index, first)
#endif

/* For kernels that are written once and specialised by constant arguments. */
#if defined(__GNUC__) || defined(__clang__)
#define DGFEM_INLINE static inline __attribute__((always_inline))
#else
#define DGFEM_INLINE static inline
#endif

DGFEM_API const char *dgfem_status_text(dgfem_status status) {
    static const char *const texts[] = {
#define DGFEM_STATUS_TEXT(name, text) text,
        DGFEM_STATUS_LIST(DGFEM_STATUS_TEXT)
#undef DGFEM_STATUS_TEXT
    };
    if ((int)status < 0 || status >= DGFEM_STATUS_COUNT) return "unknown status";
    return texts[status];
}

/* ---- log ---- */

/* Logs one line and returns the status, so that a check reads `return dgfemi_fail(...)`. */
DGFEM_PRINTF(3, 4)
static dgfem_status dgfemi_fail(const dgfem_hooks *hooks, dgfem_status status, const char *format, ...) {
    char text[512];
    va_list arguments;
    size_t used;
    if (!hooks->log) return status;
    snprintf(text, sizeof text, "dgfem: %s: ", dgfem_status_text(status));
    used = strlen(text);
    va_start(arguments, format);
    vsnprintf(text + used, sizeof text - used, format, arguments);
    va_end(arguments);
    hooks->log(hooks->log_user, DGFEM_LOG_ERROR, text);
    return status;
}

static dgfem_status dgfemi_fail_memory(const dgfem_hooks *hooks) {
    return dgfemi_fail(hooks, DGFEM_ERROR_MEMORY, "the allocator returned NULL");
}

/* ---- descriptors ---- */

#define DGFEM_COOKIE 0xd6fe3501u /* planted by every default function; catches a descriptor that was never initialised */

/* A descriptor is good when it exists and carries the cookie. The hooks of a bad one cannot be trusted: no log. */
static dgfem_status dgfemi_check_cookie(const void *desc, unsigned cookie) {
    return desc && cookie == DGFEM_COOKIE ? DGFEM_OK : DGFEM_ERROR_DESCRIPTOR;
}

/* ---- memory ---- */

static void *dgfemi_reallocate(const dgfem_hooks *hooks, void *pointer, size_t count, size_t size) {
    if (size && count > (size_t)PTRDIFF_MAX / size) return NULL;
    if (hooks->reallocate) return hooks->reallocate(hooks->reallocate_user, pointer, count * size);
    return realloc(pointer, count * size);
}

/* Room for at least one item, so that NULL always means failure. */
static void *dgfemi_allocate(const dgfem_hooks *hooks, size_t count, size_t size) {
    return dgfemi_reallocate(hooks, NULL, count ? count : 1, size);
}

static void *dgfemi_allocate_zero(const dgfem_hooks *hooks, size_t count, size_t size) {
    void *pointer = dgfemi_allocate(hooks, count, size);
    if (pointer) memset(pointer, 0, (count ? count : 1) * size);
    return pointer;
}

static void dgfemi_free(const dgfem_hooks *hooks, void *pointer) {
    if (!pointer) return;
    if (hooks->reallocate) (void)hooks->reallocate(hooks->reallocate_user, pointer, 0);
    else free(pointer);
}

static void *dgfemi_duplicate(const dgfem_hooks *hooks, const void *source, size_t count, size_t size) {
    void *copy = dgfemi_allocate(hooks, count, size);
    if (copy && count) memcpy(copy, source, count * size);
    return copy;
}

/* Grows an array to hold `needed` items, at least doubling it. Returns the new array; on failure NULL, and the old one
   stays valid. */
static void *dgfemi_grow(const dgfem_hooks *hooks, void *data, int *capacity, int needed, size_t size) {
    int wanted = *capacity < INT_MAX / 2 ? 2 * *capacity : INT_MAX;
    void *grown;
    DGFEM_ASSERT(needed > *capacity);
    if (wanted < needed) wanted = needed;
    if (wanted < 16) wanted = 16;
    grown = dgfemi_reallocate(hooks, data, (size_t)wanted, size);
    if (grown) *capacity = wanted;
    return grown;
}

/* A growable array of indices. */
typedef struct dgfemi_ints {
    int *data;
    int count, capacity;
} dgfemi_ints;

/* 1 on success, 0 when out of memory. */
static int dgfemi_push(const dgfem_hooks *hooks, dgfemi_ints *ints, int value) {
    if (ints->count == ints->capacity) {
        int *grown = (int *)dgfemi_grow(hooks, ints->data, &ints->capacity, ints->count + 1, sizeof(int));
        if (!grown) return 0;
        ints->data = grown;
    }
    ints->data[ints->count++] = value;
    return 1;
}

/* Temporary memory of one operation: many small allocations, one release. Zeroed memory is a valid empty arena once
   `hooks` is set. */
typedef struct dgfemi_arena_block {
    struct dgfemi_arena_block *next;
    size_t used, size; /* bytes behind the header */
} dgfemi_arena_block;

typedef struct dgfemi_arena {
    const dgfem_hooks *hooks;
    dgfemi_arena_block *blocks;
} dgfemi_arena;

#define DGFEM_ARENA_ALIGN ((size_t)64)

static dgfemi_arena dgfemi_arena_make(const dgfem_hooks *hooks) {
    dgfemi_arena arena;
    arena.hooks = hooks;
    arena.blocks = NULL;
    return arena;
}

static void *dgfemi_arena_allocate(dgfemi_arena *arena, size_t count, size_t size) {
    dgfemi_arena_block *block = arena->blocks;
    size_t bytes, start;
    if (size && count > (size_t)PTRDIFF_MAX / 4 / size) return NULL;
    bytes = (count * size + DGFEM_ARENA_ALIGN) & ~(DGFEM_ARENA_ALIGN - 1);
    if (!block || block->size - block->used < bytes) {
        size_t room = block ? 2 * block->size : 4096;
        if (room < bytes) room = bytes;
        block = (dgfemi_arena_block *)dgfemi_allocate(arena->hooks, sizeof *block + room + DGFEM_ARENA_ALIGN, 1);
        if (!block) return NULL;
        start = (size_t)(DGFEM_ARENA_ALIGN - (uintptr_t)(block + 1) % DGFEM_ARENA_ALIGN);
        block->next = arena->blocks;
        block->used = start;
        block->size = room + DGFEM_ARENA_ALIGN;
        arena->blocks = block;
    }
    start = block->used;
    block->used += bytes;
    return (char *)(block + 1) + start;
}

static void *dgfemi_arena_allocate_zero(dgfemi_arena *arena, size_t count, size_t size) {
    void *pointer = dgfemi_arena_allocate(arena, count, size);
    if (pointer && count > 0) memset(pointer, 0, count * size);
    return pointer;
}

static void dgfemi_arena_free(dgfemi_arena *arena) {
    while (arena->blocks) {
        dgfemi_arena_block *next = arena->blocks->next;
        dgfemi_free(arena->hooks, arena->blocks);
        arena->blocks = next;
    }
}

/* ---- parallel loops and time ---- */

static void dgfemi_parallel_for(const dgfem_hooks *hooks, int count, int grain, dgfem_range_fn fn, void *context) {
    if (count <= 0) return;
    if (hooks->parallel_for && count > grain)
        hooks->parallel_for(hooks->parallel_for_user, count, grain, fn, context);
    else
        fn(context, 0, count);
}

static double dgfemi_clock(const dgfem_hooks *hooks) { return hooks->clock ? hooks->clock(hooks->clock_user) : 0.0; }

/* ---- scalars ---- */

#if DGFEM_REAL_IS_FLOAT
#define DGFEM_EPSILON 1.1920929e-7f
#else
#define DGFEM_EPSILON 2.220446049250313e-16
#endif

static dgfem_real dgfemi_sqrt(dgfem_real x) { return (dgfem_real)sqrt((double)x); }
static dgfem_real dgfemi_abs(dgfem_real x) { return x < 0 ? -x : x; }
static dgfem_real dgfemi_min(dgfem_real a, dgfem_real b) { return a < b ? a : b; }
static dgfem_real dgfemi_max(dgfem_real a, dgfem_real b) { return a > b ? a : b; }
static int dgfemi_is_finite(dgfem_real x) { return x - x == 0; }

/* ---- strided points ---- */

static size_t dgfemi_point_stride(dgfem_number type, int stride) {
    if (stride) return (size_t)stride;
    return 3 * (type == DGFEM_FLOAT32 ? sizeof(float) : sizeof(double));
}

static dgfem_vec3 dgfemi_point_read(const dgfem_points_in *points, int i) {
    const char *data = (const char *)points->data + (size_t)i * dgfemi_point_stride(points->type, points->stride);
    dgfem_vec3 p;
    if (points->type == DGFEM_FLOAT32) {
        float v[3];
        memcpy(v, data, sizeof v);
        p.x = (dgfem_real)v[0], p.y = (dgfem_real)v[1], p.z = (dgfem_real)v[2];
    } else {
        double v[3];
        memcpy(v, data, sizeof v);
        p.x = (dgfem_real)v[0], p.y = (dgfem_real)v[1], p.z = (dgfem_real)v[2];
    }
    return p;
}

static void dgfemi_point_write(const dgfem_points_out *points, int i, dgfem_vec3 p) {
    char *data = (char *)points->data + (size_t)i * dgfemi_point_stride(points->type, points->stride);
    if (points->type == DGFEM_FLOAT32) {
        float v[3];
        v[0] = (float)p.x, v[1] = (float)p.y, v[2] = (float)p.z;
        memcpy(data, v, sizeof v);
    } else {
        double v[3];
        v[0] = (double)p.x, v[1] = (double)p.y, v[2] = (double)p.z;
        memcpy(data, v, sizeof v);
    }
}

/* A usable descriptor of points: data where there is a count, a known type, a stride that holds three numbers. */
static dgfem_status dgfemi_check_points(const dgfem_hooks *hooks, const void *data, dgfem_number type, int stride,
                                        int count, const char *what) {
    if (count < 0 || (count > 0 && !data))
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: no data for %d points", what, count);
    if (type != DGFEM_FLOAT32 && type != DGFEM_FLOAT64)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: unknown number type %d", what, (int)type);
    if (stride != 0 && (stride < 0 || (size_t)stride < dgfemi_point_stride(type, 0)))
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: a stride of %d bytes does not hold a point", what, stride);
    return DGFEM_OK;
}

static dgfem_points_in dgfemi_points_in(const void *data, dgfem_number type, int count) {
    dgfem_points_in points;
    points.data = data, points.type = type, points.stride = 0, points.count = count;
    return points;
}

static dgfem_points_out dgfemi_points_out(void *data, dgfem_number type, int count) {
    dgfem_points_out points;
    points.data = data, points.type = type, points.stride = 0, points.count = count;
    return points;
}

#define DGFEM_NUMBER_OF_REAL (DGFEM_REAL_IS_FLOAT ? DGFEM_FLOAT32 : DGFEM_FLOAT64)

DGFEM_API dgfem_points_in dgfem_points_in_float(const float *data, int count) {
    return dgfemi_points_in(data, DGFEM_FLOAT32, count);
}
DGFEM_API dgfem_points_in dgfem_points_in_double(const double *data, int count) {
    return dgfemi_points_in(data, DGFEM_FLOAT64, count);
}
DGFEM_API dgfem_points_in dgfem_points_in_vec3(const dgfem_vec3 *data, int count) {
    return dgfemi_points_in(data, DGFEM_NUMBER_OF_REAL, count);
}
DGFEM_API dgfem_points_out dgfem_points_out_float(float *data, int count) {
    return dgfemi_points_out(data, DGFEM_FLOAT32, count);
}
DGFEM_API dgfem_points_out dgfem_points_out_double(double *data, int count) {
    return dgfemi_points_out(data, DGFEM_FLOAT64, count);
}
DGFEM_API dgfem_points_out dgfem_points_out_vec3(dgfem_vec3 *data, int count) {
    return dgfemi_points_out(data, DGFEM_NUMBER_OF_REAL, count);
}

/* ==== linalg.c ==================================================================================================== */

/* Small dense algebra: vectors, 3x3 matrices, polar rotation, symmetric eigenvectors, dense Cholesky. */

static dgfem_vec3 dgfemi_vec3(dgfem_real x, dgfem_real y, dgfem_real z) {
    dgfem_vec3 v;
    v.x = x, v.y = y, v.z = z;
    return v;
}
static dgfem_vec3 dgfemi_add(dgfem_vec3 a, dgfem_vec3 b) { return dgfemi_vec3(a.x + b.x, a.y + b.y, a.z + b.z); }
static dgfem_vec3 dgfemi_sub(dgfem_vec3 a, dgfem_vec3 b) { return dgfemi_vec3(a.x - b.x, a.y - b.y, a.z - b.z); }
static dgfem_vec3 dgfemi_scale(dgfem_real s, dgfem_vec3 a) { return dgfemi_vec3(s * a.x, s * a.y, s * a.z); }
static dgfem_vec3 dgfemi_add_scaled(dgfem_vec3 a, dgfem_real s, dgfem_vec3 b) {
    return dgfemi_vec3(a.x + s * b.x, a.y + s * b.y, a.z + s * b.z);
}
static dgfem_real dgfemi_dot(dgfem_vec3 a, dgfem_vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static dgfem_vec3 dgfemi_cross(dgfem_vec3 a, dgfem_vec3 b) {
    return dgfemi_vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
static dgfem_real dgfemi_norm(dgfem_vec3 a) { return dgfemi_sqrt(dgfemi_dot(a, a)); }
static dgfem_real dgfemi_distance(dgfem_vec3 a, dgfem_vec3 b) { return dgfemi_norm(dgfemi_sub(a, b)); }
static dgfem_vec3 dgfemi_min3(dgfem_vec3 a, dgfem_vec3 b) {
    return dgfemi_vec3(dgfemi_min(a.x, b.x), dgfemi_min(a.y, b.y), dgfemi_min(a.z, b.z));
}
static dgfem_vec3 dgfemi_max3(dgfem_vec3 a, dgfem_vec3 b) {
    return dgfemi_vec3(dgfemi_max(a.x, b.x), dgfemi_max(a.y, b.y), dgfemi_max(a.z, b.z));
}
static int dgfemi_is_finite3(dgfem_vec3 a) {
    return dgfemi_is_finite(a.x) && dgfemi_is_finite(a.y) && dgfemi_is_finite(a.z);
}

/* Coordinate 0, 1, 2 of a vector. */
static dgfem_real dgfemi_axis(dgfem_vec3 a, int axis) { return axis == 0 ? a.x : axis == 1 ? a.y : a.z; }

/* Unit vector; the zero vector stays zero. */
static dgfem_vec3 dgfemi_normalized(dgfem_vec3 a) {
    dgfem_real largest = dgfemi_max(dgfemi_abs(a.x), dgfemi_max(dgfemi_abs(a.y), dgfemi_abs(a.z)));
    if (!(largest > 0)) return dgfemi_vec3(0, 0, 0);
    a = dgfemi_vec3(a.x / largest, a.y / largest, a.z / largest); /* the squares neither overflow nor vanish */
    return dgfemi_scale(1 / dgfemi_norm(a), a);
}

/* ---- 3x3 matrices ---- */

static dgfem_mat3 dgfemi_identity(void) {
    dgfem_mat3 a;
    memset(&a, 0, sizeof a);
    a.m[0][0] = a.m[1][1] = a.m[2][2] = 1;
    return a;
}

static dgfem_vec3 dgfemi_multiply(const dgfem_mat3 *a, dgfem_vec3 v) {
    return dgfemi_vec3(a->m[0][0] * v.x + a->m[0][1] * v.y + a->m[0][2] * v.z,
                       a->m[1][0] * v.x + a->m[1][1] * v.y + a->m[1][2] * v.z,
                       a->m[2][0] * v.x + a->m[2][1] * v.y + a->m[2][2] * v.z);
}

static dgfem_vec3 dgfemi_multiply_transposed(const dgfem_mat3 *a, dgfem_vec3 v) {
    return dgfemi_vec3(a->m[0][0] * v.x + a->m[1][0] * v.y + a->m[2][0] * v.z,
                       a->m[0][1] * v.x + a->m[1][1] * v.y + a->m[2][1] * v.z,
                       a->m[0][2] * v.x + a->m[1][2] * v.y + a->m[2][2] * v.z);
}

static dgfem_mat3 dgfemi_multiply3(const dgfem_mat3 *a, const dgfem_mat3 *b) {
    dgfem_mat3 c;
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            c.m[i][j] = a->m[i][0] * b->m[0][j] + a->m[i][1] * b->m[1][j] + a->m[i][2] * b->m[2][j];
    return c;
}

static dgfem_mat3 dgfemi_transposed(const dgfem_mat3 *a) {
    dgfem_mat3 t;
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) t.m[i][j] = a->m[j][i];
    return t;
}

static dgfem_real dgfemi_trace(const dgfem_mat3 *a) { return a->m[0][0] + a->m[1][1] + a->m[2][2]; }

static dgfem_real dgfemi_determinant(const dgfem_mat3 *a) {
    return a->m[0][0] * (a->m[1][1] * a->m[2][2] - a->m[1][2] * a->m[2][1]) -
           a->m[0][1] * (a->m[1][0] * a->m[2][2] - a->m[1][2] * a->m[2][0]) +
           a->m[0][2] * (a->m[1][0] * a->m[2][1] - a->m[1][1] * a->m[2][0]);
}

static dgfem_vec3 dgfemi_column(const dgfem_mat3 *a, int j) { return dgfemi_vec3(a->m[0][j], a->m[1][j], a->m[2][j]); }

static void dgfemi_set_column(dgfem_mat3 *a, int j, dgfem_vec3 v) { a->m[0][j] = v.x, a->m[1][j] = v.y, a->m[2][j] = v.z; }

/* a += s * u v^T */
static void dgfemi_add_outer(dgfem_mat3 *a, dgfem_real s, dgfem_vec3 u, dgfem_vec3 v) {
    dgfem_real su[3], w[3];
    int i, j;
    su[0] = s * u.x, su[1] = s * u.y, su[2] = s * u.z;
    w[0] = v.x, w[1] = v.y, w[2] = v.z;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) a->m[i][j] += su[i] * w[j];
}

static int dgfemi_is_finite_mat3(const dgfem_mat3 *a) {
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            if (!dgfemi_is_finite(a->m[i][j])) return 0;
    return 1;
}

/* ---- symmetric eigenvectors by cyclic Jacobi rotations ---- */

static void dgfemi_jacobi_rotate(dgfem_mat3 *a, dgfem_mat3 *v, int p, int q) {
    dgfem_real theta, t, c, s;
    int k;
    if (a->m[p][q] == 0) return;
    theta = (a->m[q][q] - a->m[p][p]) / (2 * a->m[p][q]);
    t = 1 / (dgfemi_abs(theta) + dgfemi_sqrt(theta * theta + 1));
    if (theta < 0) t = -t;
    c = 1 / dgfemi_sqrt(t * t + 1);
    s = t * c;
    for (k = 0; k < 3; k++) {
        dgfem_real x = a->m[k][p], y = a->m[k][q];
        a->m[k][p] = c * x - s * y, a->m[k][q] = s * x + c * y;
    }
    for (k = 0; k < 3; k++) {
        dgfem_real x = a->m[p][k], y = a->m[q][k];
        a->m[p][k] = c * x - s * y, a->m[q][k] = s * x + c * y;
    }
    for (k = 0; k < 3; k++) {
        dgfem_real x = v->m[k][p], y = v->m[k][q];
        v->m[k][p] = c * x - s * y, v->m[k][q] = s * x + c * y;
    }
}

DGFEM_API void dgfem_eigen_symmetric(dgfem_mat3 a, dgfem_real values[3], dgfem_mat3 *vectors) {
    enum { MAX_SWEEPS = 16 }; /* convergence is quadratic: six suffice */
    dgfem_mat3 v = dgfemi_identity(), sorted;
    int order[3] = {0, 1, 2};
    int sweep, i, j;
    for (sweep = 0; sweep < MAX_SWEEPS; sweep++) {
        dgfem_real off = dgfemi_abs(a.m[0][1]) + dgfemi_abs(a.m[0][2]) + dgfemi_abs(a.m[1][2]);
        dgfem_real diagonal = dgfemi_abs(a.m[0][0]) + dgfemi_abs(a.m[1][1]) + dgfemi_abs(a.m[2][2]);
        if (!(off > DGFEM_EPSILON * DGFEM_R(1e-3) * diagonal)) break;
        dgfemi_jacobi_rotate(&a, &v, 0, 1);
        dgfemi_jacobi_rotate(&a, &v, 0, 2);
        dgfemi_jacobi_rotate(&a, &v, 1, 2);
    }
    for (i = 0; i < 2; i++)
        for (j = 0; j < 2 - i; j++)
            if (a.m[order[j]][order[j]] > a.m[order[j + 1]][order[j + 1]]) {
                int swap = order[j];
                order[j] = order[j + 1], order[j + 1] = swap;
            }
    for (i = 0; i < 3; i++) {
        values[i] = a.m[order[i]][order[i]];
        dgfemi_set_column(&sorted, i, dgfemi_column(&v, order[i]));
    }
    if (dgfemi_determinant(&sorted) < 0) dgfemi_set_column(&sorted, 2, dgfemi_scale(-1, dgfemi_column(&sorted, 2)));
    *vectors = sorted;
}

/* ---- polar rotation ---- */

/* F = U diag(sigma) V^T with V the eigenvectors of F^T F. The two largest singular values give two columns of U; the
   third is their cross product, which also makes det(U V^T) = +1 and so flips the smallest singular vector of an
   inverted F. */
DGFEM_API dgfem_mat3 dgfem_rotation_of(dgfem_mat3 f, dgfem_mat3 fallback) {
    dgfem_mat3 ft, gram, v, u, vt;
    dgfem_real squares[3], sigma1, sigma2, sigma3;
    dgfem_vec3 u1, u2;
    if (!dgfemi_is_finite_mat3(&f)) return fallback;
    ft = dgfemi_transposed(&f);
    gram = dgfemi_multiply3(&ft, &f);
    dgfem_eigen_symmetric(gram, squares, &v);
    u1 = dgfemi_multiply(&f, dgfemi_column(&v, 2));
    sigma1 = dgfemi_norm(u1);
    if (!(sigma1 > 0)) return fallback;
    u1 = dgfemi_scale(1 / sigma1, u1);
    u2 = dgfemi_multiply(&f, dgfemi_column(&v, 1));
    u2 = dgfemi_add_scaled(u2, -dgfemi_dot(u1, u2), u1);
    sigma2 = dgfemi_norm(u2);
    sigma3 = dgfemi_norm(dgfemi_multiply(&f, dgfemi_column(&v, 0)));
    if (!(sigma2 + sigma3 > DGFEM_R(1e-6) * sigma1) || !(sigma2 > 0)) return fallback;
    u2 = dgfemi_scale(1 / sigma2, u2);
    dgfemi_set_column(&u, 2, u1);
    dgfemi_set_column(&u, 1, u2);
    dgfemi_set_column(&u, 0, dgfemi_cross(u2, u1)); /* v is right-handed: v0 = v1 x v2 */
    vt = dgfemi_transposed(&v);
    return dgfemi_multiply3(&u, &vt);
}

/* ---- dense Cholesky of small blocks, row-major ---- */

/* Lower triangle of a becomes L with A = L L^T. 0 when a pivot is not positive. */
static int dgfemi_cholesky_dense(dgfem_real *a, int n) {
    int i, j, k;
    for (j = 0; j < n; j++) {
        dgfem_real pivot = a[j * n + j];
        for (k = 0; k < j; k++) pivot -= a[j * n + k] * a[j * n + k];
        if (!(pivot > 0) || !dgfemi_is_finite(pivot)) return 0;
        pivot = dgfemi_sqrt(pivot);
        a[j * n + j] = pivot;
        for (i = j + 1; i < n; i++) {
            dgfem_real sum = a[i * n + j];
            for (k = 0; k < j; k++) sum -= a[i * n + k] * a[j * n + k];
            a[i * n + j] = sum / pivot;
        }
    }
    return 1;
}

/* x = (L L^T)^-1 x for `columns` interleaved right-hand sides: x[row * columns + column]. */
static void dgfemi_cholesky_dense_solve(const dgfem_real *l, int n, dgfem_real *x, int columns) {
    int i, k, c;
    for (i = 0; i < n; i++)
        for (c = 0; c < columns; c++) {
            dgfem_real sum = x[i * columns + c];
            for (k = 0; k < i; k++) sum -= l[i * n + k] * x[k * columns + c];
            x[i * columns + c] = sum / l[i * n + i];
        }
    for (i = n - 1; i >= 0; i--)
        for (c = 0; c < columns; c++) {
            dgfem_real sum = x[i * columns + c];
            for (k = i + 1; k < n; k++) sum -= l[k * n + i] * x[k * columns + c];
            x[i * columns + c] = sum / l[i * n + i];
        }
}

/* ==== planar.c ==================================================================================================== */

/* Planar regions bounded by loops: which side of a line, simplicity, triangles. Decisions are made on stored
   coordinates with exact arithmetic, so that they never contradict each other.

   A region is projected along the axis nearest to its normal, which only drops one coordinate. Outer loops then run
   counter-clockwise, holes clockwise. */

/* ---- exact orientation ---- */

/* a b = product + *error exactly. Where fma is an instruction it gives the error; elsewhere Dekker's splitting of the
   factors into halves of 26 bits does. */
static double dgfemi_two_product(double a, double b, double *error) {
    const double product = a * b;
#if defined(__FMA__) || defined(__ARM_FEATURE_FMA) || defined(FP_FAST_FMA)
    *error = fma(a, b, -product);
#else
    const double split = 134217729.0, ap = split * a, bp = split * b; /* 2^27 + 1 */
    const double ah = ap - (ap - a), al = a - ah, bh = bp - (bp - b), bl = b - bh;
    *error = ((ah * bh - product) + ah * bl + al * bh) + al * bl;
#endif
    return product;
}

/* a + b = sum + *error exactly (Knuth). */
static double dgfemi_two_sum(double a, double b, double *error) {
    const double sum = a + b, b_part = sum - a, a_part = sum - b_part;
    *error = (a - a_part) + (b - b_part);
    return sum;
}

static int dgfemi_sign(double x) { return (x > 0) - (x < 0); }

/* The determinant without differences, a_x b_y - a_y b_x + ..., summed as an expansion: numbers that do not overlap,
   the last one the largest (J. R. Shewchuk, "Adaptive precision floating-point arithmetic", 1997). */
static int dgfemi_orientation_by_expansion(const double *a, const double *b, const double *c) {
    const double factors[6][2] = {{a[0], b[1]},  {-a[1], b[0]}, {b[0], c[1]},
                                  {-b[1], c[0]}, {c[0], a[1]},  {-c[1], a[0]}};
    double expansion[12];
    int count = 0, i, k, part;
    for (i = 0; i < 6; i++) {
        double parts[2];
        parts[1] = dgfemi_two_product(factors[i][0], factors[i][1], &parts[0]);
        for (part = 0; part < 2; part++) {
            double sum = parts[part];
            for (k = 0; k < count; k++) sum = dgfemi_two_sum(sum, expansion[k], &expansion[k]);
            expansion[count++] = sum;
        }
    }
    while (count > 1 && expansion[count - 1] == 0) count--;
    return dgfemi_sign(expansion[count - 1]);
}

/* 1 when a, b, c turn left, -1 when they turn right, 0 when they lie on a line: exact. */
static int dgfemi_orientation(const double *a, const double *b, const double *c) {
    const double error_bound = 3.3306690738754716e-16; /* of the plain determinant, relative to its two terms */
    double tails[4], p_error, q_error;
    const double ax = dgfemi_two_sum(a[0], -c[0], &tails[0]), by = dgfemi_two_sum(b[1], -c[1], &tails[1]);
    const double ay = dgfemi_two_sum(a[1], -c[1], &tails[2]), bx = dgfemi_two_sum(b[0], -c[0], &tails[3]);
    double p = ax * by, q = ay * bx;
    if (fabs(p - q) > error_bound * (fabs(p) + fabs(q))) return dgfemi_sign(p - q);
    if (tails[0] != 0 || tails[1] != 0 || tails[2] != 0 || tails[3] != 0)
        return dgfemi_orientation_by_expansion(a, b, c);
    p = dgfemi_two_product(ax, by, &p_error);
    q = dgfemi_two_product(ay, bx, &q_error);
    return p != q ? dgfemi_sign(p - q) : dgfemi_sign(p_error - q_error);
}

/* ---- regions ---- */

/* Twice the vector area of a loop. */
static dgfem_vec3 dgfemi_loop_vector_area(const dgfem_vec3 *vertices, const int *loop, int count) {
    dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
    int i;
    for (i = 2; i < count; i++)
        sum = dgfemi_add(sum, dgfemi_cross(dgfemi_sub(vertices[loop[i - 1]], vertices[loop[0]]),
                                           dgfemi_sub(vertices[loop[i]], vertices[loop[0]])));
    return sum;
}

/* The two axes that stay when a region is projected along the largest component of its normal, in the order in which
   its loops keep their sense. */
static void dgfemi_projection_axes(dgfem_vec3 normal, int *u, int *v) {
    const dgfem_real x = dgfemi_abs(normal.x), y = dgfemi_abs(normal.y), z = dgfemi_abs(normal.z);
    const int dropped = x > y && x > z ? 0 : y > z ? 1 : 2;
    const int forward = dgfemi_axis(normal, dropped) >= 0;
    *u = (dropped + (forward ? 1 : 2)) % 3;
    *v = (dropped + (forward ? 2 : 1)) % 3;
}

/* Corners are nodes of circular lists, one for each loop; node i belongs to loop_of[i]. */
typedef struct dgfemi_planar {
    double (*point)[2];
    int *vertex, *next, *previous, *loop_of;
    int *loop_start;   /* [loop_count + 1] original nodes of each loop */
    double *loop_area; /* twice */
    unsigned char *reflex;
    int *reflex_nodes; /* those with reflex[] set, and some that had it once */
    int node_count, loop_count, reflex_count;
} dgfemi_planar;

/* Nodes that bridges to holes may add: two for each loop but one. */
static int dgfemi_planar_allocate(dgfemi_planar *p, dgfemi_arena *arena, int corners, int loops) {
    const size_t nodes = (size_t)corners + 2 * (size_t)loops;
    p->point = (double(*)[2])dgfemi_arena_allocate(arena, nodes, sizeof *p->point);
    p->vertex = (int *)dgfemi_arena_allocate(arena, nodes, sizeof(int));
    p->next = (int *)dgfemi_arena_allocate(arena, nodes, sizeof(int));
    p->previous = (int *)dgfemi_arena_allocate(arena, nodes, sizeof(int));
    p->loop_of = (int *)dgfemi_arena_allocate(arena, nodes, sizeof(int));
    p->reflex = (unsigned char *)dgfemi_arena_allocate(arena, nodes, 1);
    p->reflex_nodes = (int *)dgfemi_arena_allocate(arena, nodes, sizeof(int));
    p->loop_start = (int *)dgfemi_arena_allocate(arena, (size_t)loops + 1, sizeof(int));
    p->loop_area = (double *)dgfemi_arena_allocate(arena, (size_t)loops, sizeof(double));
    return p->point && p->vertex && p->next && p->previous && p->loop_of && p->reflex && p->reflex_nodes &&
           p->loop_start && p->loop_area;
}

static void dgfemi_planar_add_loop(dgfemi_planar *p, const dgfem_vec3 *vertices, const int *loop, int count, int u,
                                   int v) {
    const int start = p->node_count;
    double area = 0;
    int i;
    for (i = 0; i < count; i++) {
        const int node = start + i;
        p->vertex[node] = loop[i];
        p->point[node][0] = (double)dgfemi_axis(vertices[loop[i]], u);
        p->point[node][1] = (double)dgfemi_axis(vertices[loop[i]], v);
        p->next[node] = i + 1 < count ? node + 1 : start;
        p->previous[node] = i > 0 ? node - 1 : start + count - 1;
        p->loop_of[node] = p->loop_count;
    }
    for (i = start + 1; i + 1 < start + count; i++)
        area += (p->point[i][0] - p->point[start][0]) * (p->point[i + 1][1] - p->point[start][1]) -
                (p->point[i][1] - p->point[start][1]) * (p->point[i + 1][0] - p->point[start][0]);
    p->loop_area[p->loop_count++] = area;
    p->loop_start[p->loop_count] = p->node_count = start + count;
}

/* The region of loop_count loops; loop l has the vertices loop_vertices[loop_start[l] .. loop_start[l + 1] - 1]. 0 when
   out of memory. */
static int dgfemi_planar_make(dgfemi_planar *p, dgfemi_arena *arena, const dgfem_vec3 *vertices,
                              const int *loop_vertices, const int *loop_start, int loop_count, dgfem_vec3 normal) {
    int u, v, l;
    if (!dgfemi_planar_allocate(p, arena, loop_start[loop_count] - loop_start[0], loop_count)) return 0;
    p->node_count = p->loop_count = p->reflex_count = 0;
    p->loop_start[0] = 0;
    dgfemi_projection_axes(normal, &u, &v);
    for (l = 0; l < loop_count; l++)
        dgfemi_planar_add_loop(p, vertices, loop_vertices + loop_start[l], loop_start[l + 1] - loop_start[l], u, v);
    return 1;
}

static int dgfemi_planar_turn(const dgfemi_planar *p, int a, int b, int c) {
    return dgfemi_orientation(p->point[a], p->point[b], p->point[c]);
}

static double dgfemi_larger(double a, double b) { return a > b ? a : b; }
static double dgfemi_smaller(double a, double b) { return a < b ? a : b; }

/* Whether the boxes of the segments a-b and c-d meet along one axis. */
static int dgfemi_planar_overlap(const dgfemi_planar *p, int a, int b, int c, int d, int axis) {
    const double as = p->point[a][axis], bs = p->point[b][axis], cs = p->point[c][axis], ds = p->point[d][axis];
    return dgfemi_larger(as, bs) >= dgfemi_smaller(cs, ds) && dgfemi_larger(cs, ds) >= dgfemi_smaller(as, bs);
}

/* Whether the closed segments a-b and c-d have a point in common. */
static int dgfemi_planar_meet(const dgfemi_planar *p, int a, int b, int c, int d) {
    if (!dgfemi_planar_overlap(p, a, b, c, d, 0) || !dgfemi_planar_overlap(p, a, b, c, d, 1)) return 0;
    return dgfemi_planar_turn(p, a, b, c) * dgfemi_planar_turn(p, a, b, d) <= 0 &&
           dgfemi_planar_turn(p, c, d, a) * dgfemi_planar_turn(p, c, d, b) <= 0;
}

/* ---- simplicity ---- */

/* Whether the edge b-c runs back over the edge a-b. */
static int dgfemi_planar_folds(const dgfemi_planar *p, int a, int b, int c) {
    int axis;
    if (dgfemi_planar_turn(p, a, b, c) != 0) return 0;
    for (axis = 0; axis < 2; axis++) {
        const double at = p->point[a][axis], bt = p->point[b][axis], ct = p->point[c][axis];
        if ((at > bt && ct > bt) || (at < bt && ct < bt)) return 1;
    }
    return 0;
}

static double dgfemi_planar_left_end(const dgfemi_planar *p, int edge) {
    return dgfemi_smaller(p->point[edge][0], p->point[p->next[edge]][0]);
}

/* Heap sort of edges by their left end. */
static void dgfemi_planar_sort_edges(const dgfemi_planar *p, int *edges, int count) {
    int root, last = count, start = count / 2;
    while (last > 1) {
        int moved;
        if (start > 0) {
            moved = edges[--start];
        } else {
            moved = edges[--last];
            edges[last] = edges[0];
        }
        for (root = start; 2 * root + 1 < last;) {
            int child = 2 * root + 1;
            if (child + 1 < last &&
                dgfemi_planar_left_end(p, edges[child]) < dgfemi_planar_left_end(p, edges[child + 1]))
                child++;
            if (dgfemi_planar_left_end(p, edges[child]) <= dgfemi_planar_left_end(p, moved)) break;
            edges[root] = edges[child];
            root = child;
        }
        edges[root] = moved;
    }
}

static int dgfemi_planar_edges_clash(const dgfemi_planar *p, int e, int f) {
    if (p->next[e] == f) return dgfemi_planar_folds(p, e, f, p->next[f]);
    if (p->next[f] == e) return dgfemi_planar_folds(p, f, e, p->next[e]);
    return dgfemi_planar_meet(p, e, p->next[e], f, p->next[f]);
}

/* Two edges, named by their first nodes, that cross or touch; 0 when there are none. Uses reflex_nodes. */
static int dgfemi_planar_find_clash(dgfemi_planar *p, int *first, int *second) {
    int *edges = p->reflex_nodes;
    int i, j;
    for (i = 0; i < p->node_count; i++) edges[i] = i;
    dgfemi_planar_sort_edges(p, edges, p->node_count);
    for (i = 0; i < p->node_count; i++) {
        const double right = dgfemi_larger(p->point[edges[i]][0], p->point[p->next[edges[i]]][0]);
        for (j = i + 1; j < p->node_count && dgfemi_planar_left_end(p, edges[j]) <= right; j++)
            if (dgfemi_planar_edges_clash(p, edges[i], edges[j])) {
                *first = edges[i], *second = edges[j];
                return 1;
            }
    }
    return 0;
}

/* How often the edge a-b winds counter-clockwise round q as seen along the ray from q to the right: 1, 0 or -1. An end
   on the ray counts as below it, so that no corner counts twice or is missed. */
static int dgfemi_edge_winding(const double *a, const double *b, const double *q) {
    if (a[1] <= q[1] && b[1] > q[1]) return dgfemi_orientation(a, b, q) > 0;
    if (b[1] <= q[1] && a[1] > q[1]) return dgfemi_orientation(b, a, q) > 0 ? -1 : 0;
    return 0;
}

/* A loop that lies on the wrong side of the others, or DGFEM_NONE: outer loops must lie outside the region that the
   others bound, holes inside. For loops that do not meet. */
static int dgfemi_planar_find_misplaced(const dgfemi_planar *p) {
    int l, i;
    for (l = 0; p->loop_count > 1 && l < p->loop_count; l++) {
        int winding = 0;
        for (i = 0; i < p->node_count; i++)
            if (p->loop_of[i] != l)
                winding += dgfemi_edge_winding(p->point[i], p->point[p->next[i]], p->point[p->loop_start[l]]);
        if (winding != (p->loop_area[l] > 0 ? 0 : 1)) return l;
    }
    return DGFEM_NONE;
}

/* ---- triangles: bridges join holes to other loops, then ears are clipped ---- */

/* Whether the direction from node a to node b points strictly into the region at a. */
static int dgfemi_planar_in_cone(const dgfemi_planar *p, int a, int b) {
    const int before = p->previous[a], after = p->next[a];
    if (dgfemi_planar_turn(p, before, a, after) >= 0)
        return dgfemi_planar_turn(p, a, b, before) > 0 && dgfemi_planar_turn(p, b, a, after) > 0;
    return !(dgfemi_planar_turn(p, a, b, after) >= 0 && dgfemi_planar_turn(p, b, a, before) >= 0);
}

static int dgfemi_planar_is_right_of(const dgfemi_planar *p, int a, int b) {
    return p->point[a][0] > p->point[b][0] || (p->point[a][0] == p->point[b][0] && p->point[a][1] > p->point[b][1]);
}

static int dgfemi_planar_rightmost(const dgfemi_planar *p, int loop) {
    int best = p->loop_start[loop], i;
    for (i = best + 1; i < p->loop_start[loop + 1]; i++)
        if (dgfemi_planar_is_right_of(p, i, best)) best = i;
    return best;
}

/* Whether the segment between nodes a and b touches no edge but those that end at their vertices, and lies in the
   region at both ends. */
static int dgfemi_planar_sees(const dgfemi_planar *p, int a, int b) {
    int i;
    if (!dgfemi_planar_in_cone(p, a, b) || !dgfemi_planar_in_cone(p, b, a)) return 0;
    for (i = 0; i < p->node_count; i++) {
        const int from = p->vertex[i], to = p->vertex[p->next[i]];
        if (from == p->vertex[a] || from == p->vertex[b] || to == p->vertex[a] || to == p->vertex[b]) continue;
        if (dgfemi_planar_meet(p, a, b, i, p->next[i])) return 0;
    }
    return 1;
}

/* Of the nodes that qualify, the one that follows in the order of distance from `from` (ties by number) after *distance
   and `last`; DGFEM_NONE at the end. A node qualifies when it lies right of `from` or, with any_side, when it
   belongs to another group of joined loops. */
static int dgfemi_planar_next_nearest(const dgfemi_planar *p, const int *group, int from, int any_side, int last,
                                      double *distance) {
    double best_distance = 0;
    int best = DGFEM_NONE, i;
    for (i = 0; i < p->node_count; i++) {
        const double dx = p->point[i][0] - p->point[from][0], dy = p->point[i][1] - p->point[from][1];
        const double d = dx * dx + dy * dy;
        if (any_side ? group[p->loop_of[i]] == group[p->loop_of[from]] : !dgfemi_planar_is_right_of(p, i, from))
            continue;
        if (last != DGFEM_NONE && (d < *distance || (d == *distance && i <= last))) continue;
        if (best == DGFEM_NONE || d < best_distance) best = i, best_distance = d;
    }
    *distance = best_distance;
    return best;
}

/* Makes one loop of two:  .. a b ..  and  .. m ..  become  .. a m .. m' a' b ..  where a' and m' are copies. */
static void dgfemi_planar_bridge(dgfemi_planar *p, int a, int m) {
    const int m_copy = p->node_count++, a_copy = p->node_count++, b = p->next[a], before = p->previous[m];
    p->vertex[m_copy] = p->vertex[m], p->vertex[a_copy] = p->vertex[a];
    memcpy(p->point[m_copy], p->point[m], sizeof p->point[m]);
    memcpy(p->point[a_copy], p->point[a], sizeof p->point[a]);
    p->loop_of[m_copy] = p->loop_of[m], p->loop_of[a_copy] = p->loop_of[a];
    p->next[a] = m, p->previous[m] = a;
    p->next[before] = m_copy, p->previous[m_copy] = before;
    p->next[m_copy] = a_copy, p->previous[a_copy] = m_copy;
    p->next[a_copy] = b, p->previous[b] = a_copy;
}

/* Joins a hole to the nearest node to the right of its rightmost vertex that sees it. In a region that is simple there
   always is one, and it cannot belong to what was joined to the hole before, since that all lies to the left. In any
   other region the nearest node of another group must do. */
static void dgfemi_planar_join_hole(dgfemi_planar *p, int *group, int hole) {
    const int rightmost = dgfemi_planar_rightmost(p, hole);
    const int original_count = p->loop_start[p->loop_count];
    double distance = 0;
    int at = rightmost, target = DGFEM_NONE, found = 0, merged, l;
    while (!found && (target = dgfemi_planar_next_nearest(p, group, rightmost, 0, target, &distance)) != DGFEM_NONE) {
        if (group[p->loop_of[target]] == group[hole]) continue;
        at = rightmost;
        found = dgfemi_planar_sees(p, at, target);
        for (l = original_count; !found && l < p->node_count; l++) /* copies made by bridges that end here */
            if (p->vertex[l] == p->vertex[rightmost]) found = dgfemi_planar_sees(p, at = l, target);
    }
    if (!found) at = rightmost, target = dgfemi_planar_next_nearest(p, group, at, 1, DGFEM_NONE, &distance);
    DGFEM_ASSERT(target != DGFEM_NONE);
    merged = group[p->loop_of[target]];
    for (l = 0; l < p->loop_count; l++)
        if (group[l] == merged) group[l] = group[hole];
    dgfemi_planar_bridge(p, target, at);
}

/* The loop that is not to be joined although its area is not positive: only where no loop has one. */
static int dgfemi_planar_lone_outer(const dgfemi_planar *p) {
    int l, best = 0;
    for (l = 0; l < p->loop_count; l++)
        if (p->loop_area[l] > 0) return DGFEM_NONE;
    for (l = 1; l < p->loop_count; l++)
        if (dgfemi_planar_is_right_of(p, dgfemi_planar_rightmost(p, l), dgfemi_planar_rightmost(p, best))) best = l;
    return best;
}

static int dgfemi_planar_is_hole(const dgfemi_planar *p, int loop, int lone_outer) {
    return !(p->loop_area[loop] > 0) && loop != lone_outer;
}

static void dgfemi_planar_set_reflex(dgfemi_planar *p, int node) {
    p->reflex[node] = dgfemi_planar_turn(p, p->previous[node], node, p->next[node]) <= 0;
}

static int dgfemi_planar_in_triangle(const dgfemi_planar *p, int a, int b, int c, int q) {
    int axis;
    for (axis = 0; axis < 2; axis++) {
        const double t = p->point[q][axis], x = p->point[a][axis], y = p->point[b][axis], z = p->point[c][axis];
        if ((t < x && t < y && t < z) || (t > x && t > y && t > z)) return 0;
    }
    return dgfemi_planar_turn(p, a, b, q) >= 0 && dgfemi_planar_turn(p, b, c, q) >= 0 &&
           dgfemi_planar_turn(p, c, a, q) >= 0;
}

/* Whether the triangle of a node and its neighbours can be cut off: it has area, its third side lies in the region, and
   no other vertex lies in it or on that side. Only vertices with an angle of 180 degrees or more need a look. */
static int dgfemi_planar_is_ear(dgfemi_planar *p, int node) {
    const int before = p->previous[node], after = p->next[node];
    int i = 0;
    if (p->reflex[node] || !dgfemi_planar_in_cone(p, before, after) || !dgfemi_planar_in_cone(p, after, before))
        return 0;
    while (i < p->reflex_count) {
        const int other = p->reflex_nodes[i], v = p->vertex[other];
        if (!p->reflex[other]) { /* no longer: angles only shrink */
            p->reflex_nodes[i] = p->reflex_nodes[--p->reflex_count];
            continue;
        }
        if (v != p->vertex[before] && v != p->vertex[node] && v != p->vertex[after] &&
            dgfemi_planar_in_triangle(p, before, node, after, other))
            return 0;
        i++;
    }
    return 1;
}

typedef struct dgfemi_triangles {
    int *data;
    int capacity, count; /* count goes on beyond capacity */
} dgfemi_triangles;

/* Cuts off the node and the triangle with its neighbours. */
static void dgfemi_planar_clip(dgfemi_planar *p, int node, dgfemi_triangles *out) {
    const int before = p->previous[node], after = p->next[node];
    if (out->count < out->capacity) {
        int *t = out->data + 3 * out->count;
        t[0] = p->vertex[before], t[1] = p->vertex[node], t[2] = p->vertex[after];
    }
    out->count++;
    p->next[before] = after, p->previous[after] = before;
    p->reflex[node] = 0;
    dgfemi_planar_set_reflex(p, before);
    dgfemi_planar_set_reflex(p, after);
}

/* A loop that is simple always has an ear. In any other, where a whole round finds none, a convex corner goes. */
static void dgfemi_planar_clip_loop(dgfemi_planar *p, int node, dgfemi_triangles *out) {
    int left = 1, misses = 0, i;
    for (i = p->next[node]; i != node; i = p->next[i]) left++;
    while (left >= 3) {
        const int force = misses > left && (!p->reflex[node] || misses > 2 * left);
        if (left == 3 || force || dgfemi_planar_is_ear(p, node)) {
            const int after = p->next[node];
            dgfemi_planar_clip(p, node, out);
            node =
                left > 4 ? p->next[after] : after; /* not twice at the same corner: that would make fans of slivers */
            left--;
            misses = 0;
        } else {
            node = p->next[node];
            misses++;
        }
    }
}

/* Number of triangles: a loop of n corners gives n - 2, a hole of n corners n + 2. */
static int dgfemi_planar_triangle_count(const dgfemi_planar *p) {
    const int lone_outer = dgfemi_planar_lone_outer(p);
    int count = p->loop_start[p->loop_count], l;
    for (l = 0; l < p->loop_count; l++) count += dgfemi_planar_is_hole(p, l, lone_outer) ? 2 : -2;
    return count;
}

/* Triangles that cover the region. Where it is not simple they have the right boundary but may overlap. `group` is room
   for one int per loop. Consumes the lists. */
static void dgfemi_planar_triangulate(dgfemi_planar *p, int *group, dgfemi_triangles *out) {
    const int lone_outer = dgfemi_planar_lone_outer(p);
    int l, i;
    for (l = 0; l < p->loop_count; l++) group[l] = l;
    for (l = 0; l < p->loop_count; l++)
        if (dgfemi_planar_is_hole(p, l, lone_outer)) dgfemi_planar_join_hole(p, group, l);
    p->reflex_count = 0;
    for (i = 0; i < p->node_count; i++) {
        dgfemi_planar_set_reflex(p, i);
        if (p->reflex[i]) p->reflex_nodes[p->reflex_count++] = i;
    }
    for (l = 0; l < p->loop_count; l++)
        if (!dgfemi_planar_is_hole(p, l, lone_outer)) dgfemi_planar_clip_loop(p, p->loop_start[l], out);
}

/* ==== moments.c =================================================================================================== */

/* Integrals of all monomials over polyhedra and planar polygons, from signed tetrahedra and triangles.

   A closed surface, cut into triangles, with any apex o gives signed tetrahedra that add up to its interior, convex or
   not. The apex is a vertex, so that the faces around it drop out; the others are cut into fans:

       loop v0 v1 v2 v3 v4:              v3         a = v0, b = v1, c = v2, d = v3: the tetrahedra (o,a,b,c) and
                                        /| \        (o,a,c,d) are one pair; then b = v3, c = v4
                                      v4 |  v2
                                        \| /        o somewhere else, on other faces
                                         v0-v1

   A planar polygon with holes is the sum of signed triangles of an apex with the edges of its loops.

   Everything is relative, never in global coordinates: volumes come from differences to the apex, positions from
   differences to the centre. Those differences are the only place where an offset could cost digits, and they are exact
   or correctly rounded. They are divided by the power of two next to the caller's length scale, which is exact and
   keeps all powers within the range of float. */

DGFEM_API int dgfem_monomial_count(int degree) {
    return degree < 0 ? 0 : (degree + 1) * (degree + 2) * (degree + 3) / 6;
}

DGFEM_API int dgfem_monomial_index(int i, int j, int k) {
    return dgfem_monomial_count(i + j + k - 1) + (j + k) * (j + k + 1) / 2 + k;
}

/* ---- the recursion, several pairs of triangles side by side ---- */

/* Lanes fill 32 bytes: one AVX register, two of SSE or NEON. */
#define DGFEM_LANES ((int)(32 / sizeof(dgfem_real)))

static dgfem_real dgfemi_moments_lane_total(const dgfem_real *lanes) {
#if DGFEM_REAL_IS_FLOAT
    return ((lanes[0] + lanes[1]) + (lanes[2] + lanes[3])) + ((lanes[4] + lanes[5]) + (lanes[6] + lanes[7]));
#else
    return (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]);
#endif
}

/* Generated by src/gen/moments_gen.c: the integrals of all monomials up to degree 6. */

#define DGFEM_MOMENTS_DEGREE 6
#define DGFEM_MOMENTS_COUNT 84
#define DGFEM_MOMENTS_LAYER 84 /* p, q, c, t of the largest layer that a block hands on */

/* i! j! k! / (i+j+k+3)! */
static const dgfem_real dgfemi_volume_factors[84] = {
    DGFEM_R(1.0 / 6), DGFEM_R(1.0 / 24), DGFEM_R(1.0 / 24), DGFEM_R(1.0 / 24), DGFEM_R(1.0 / 60),
    DGFEM_R(1.0 / 120), DGFEM_R(1.0 / 120), DGFEM_R(1.0 / 60), DGFEM_R(1.0 / 120), DGFEM_R(1.0 / 60),
    DGFEM_R(1.0 / 120), DGFEM_R(1.0 / 360), DGFEM_R(1.0 / 360), DGFEM_R(1.0 / 360), DGFEM_R(1.0 / 720),
    DGFEM_R(1.0 / 360), DGFEM_R(1.0 / 120), DGFEM_R(1.0 / 360), DGFEM_R(1.0 / 360), DGFEM_R(1.0 / 120),
    DGFEM_R(1.0 / 210), DGFEM_R(1.0 / 840), DGFEM_R(1.0 / 840), DGFEM_R(1.0 / 1260), DGFEM_R(1.0 / 2520),
    DGFEM_R(1.0 / 1260), DGFEM_R(1.0 / 840), DGFEM_R(1.0 / 2520), DGFEM_R(1.0 / 2520), DGFEM_R(1.0 / 840),
    DGFEM_R(1.0 / 210), DGFEM_R(1.0 / 840), DGFEM_R(1.0 / 1260), DGFEM_R(1.0 / 840), DGFEM_R(1.0 / 210),
    DGFEM_R(1.0 / 336), DGFEM_R(1.0 / 1680), DGFEM_R(1.0 / 1680), DGFEM_R(1.0 / 3360), DGFEM_R(1.0 / 6720),
    DGFEM_R(1.0 / 3360), DGFEM_R(1.0 / 3360), DGFEM_R(1.0 / 10080), DGFEM_R(1.0 / 10080), DGFEM_R(1.0 / 3360),
    DGFEM_R(1.0 / 1680), DGFEM_R(1.0 / 6720), DGFEM_R(1.0 / 10080), DGFEM_R(1.0 / 6720), DGFEM_R(1.0 / 1680),
    DGFEM_R(1.0 / 336), DGFEM_R(1.0 / 1680), DGFEM_R(1.0 / 3360), DGFEM_R(1.0 / 3360), DGFEM_R(1.0 / 1680),
    DGFEM_R(1.0 / 336), DGFEM_R(1.0 / 504), DGFEM_R(1.0 / 3024), DGFEM_R(1.0 / 3024), DGFEM_R(1.0 / 7560),
    DGFEM_R(1.0 / 15120), DGFEM_R(1.0 / 7560), DGFEM_R(1.0 / 10080), DGFEM_R(1.0 / 30240), DGFEM_R(1.0 / 30240),
    DGFEM_R(1.0 / 10080), DGFEM_R(1.0 / 7560), DGFEM_R(1.0 / 30240), DGFEM_R(1.0 / 45360), DGFEM_R(1.0 / 30240),
    DGFEM_R(1.0 / 7560), DGFEM_R(1.0 / 3024), DGFEM_R(1.0 / 15120), DGFEM_R(1.0 / 30240), DGFEM_R(1.0 / 30240),
    DGFEM_R(1.0 / 15120), DGFEM_R(1.0 / 3024), DGFEM_R(1.0 / 504), DGFEM_R(1.0 / 3024), DGFEM_R(1.0 / 7560),
    DGFEM_R(1.0 / 10080), DGFEM_R(1.0 / 7560), DGFEM_R(1.0 / 3024), DGFEM_R(1.0 / 504)
};

/* i! j! k! / (i+j+k+2)! */
static const dgfem_real dgfemi_face_factors[84] = {
    DGFEM_R(1.0 / 2), DGFEM_R(1.0 / 6), DGFEM_R(1.0 / 6), DGFEM_R(1.0 / 6), DGFEM_R(1.0 / 12),
    DGFEM_R(1.0 / 24), DGFEM_R(1.0 / 24), DGFEM_R(1.0 / 12), DGFEM_R(1.0 / 24), DGFEM_R(1.0 / 12),
    DGFEM_R(1.0 / 20), DGFEM_R(1.0 / 60), DGFEM_R(1.0 / 60), DGFEM_R(1.0 / 60), DGFEM_R(1.0 / 120),
    DGFEM_R(1.0 / 60), DGFEM_R(1.0 / 20), DGFEM_R(1.0 / 60), DGFEM_R(1.0 / 60), DGFEM_R(1.0 / 20),
    DGFEM_R(1.0 / 30), DGFEM_R(1.0 / 120), DGFEM_R(1.0 / 120), DGFEM_R(1.0 / 180), DGFEM_R(1.0 / 360),
    DGFEM_R(1.0 / 180), DGFEM_R(1.0 / 120), DGFEM_R(1.0 / 360), DGFEM_R(1.0 / 360), DGFEM_R(1.0 / 120),
    DGFEM_R(1.0 / 30), DGFEM_R(1.0 / 120), DGFEM_R(1.0 / 180), DGFEM_R(1.0 / 120), DGFEM_R(1.0 / 30),
    DGFEM_R(1.0 / 42), DGFEM_R(1.0 / 210), DGFEM_R(1.0 / 210), DGFEM_R(1.0 / 420), DGFEM_R(1.0 / 840),
    DGFEM_R(1.0 / 420), DGFEM_R(1.0 / 420), DGFEM_R(1.0 / 1260), DGFEM_R(1.0 / 1260), DGFEM_R(1.0 / 420),
    DGFEM_R(1.0 / 210), DGFEM_R(1.0 / 840), DGFEM_R(1.0 / 1260), DGFEM_R(1.0 / 840), DGFEM_R(1.0 / 210),
    DGFEM_R(1.0 / 42), DGFEM_R(1.0 / 210), DGFEM_R(1.0 / 420), DGFEM_R(1.0 / 420), DGFEM_R(1.0 / 210),
    DGFEM_R(1.0 / 42), DGFEM_R(1.0 / 56), DGFEM_R(1.0 / 336), DGFEM_R(1.0 / 336), DGFEM_R(1.0 / 840),
    DGFEM_R(1.0 / 1680), DGFEM_R(1.0 / 840), DGFEM_R(1.0 / 1120), DGFEM_R(1.0 / 3360), DGFEM_R(1.0 / 3360),
    DGFEM_R(1.0 / 1120), DGFEM_R(1.0 / 840), DGFEM_R(1.0 / 3360), DGFEM_R(1.0 / 5040), DGFEM_R(1.0 / 3360),
    DGFEM_R(1.0 / 840), DGFEM_R(1.0 / 336), DGFEM_R(1.0 / 1680), DGFEM_R(1.0 / 3360), DGFEM_R(1.0 / 3360),
    DGFEM_R(1.0 / 1680), DGFEM_R(1.0 / 336), DGFEM_R(1.0 / 56), DGFEM_R(1.0 / 336), DGFEM_R(1.0 / 840),
    DGFEM_R(1.0 / 1120), DGFEM_R(1.0 / 840), DGFEM_R(1.0 / 336), DGFEM_R(1.0 / 56)
};

/* Sums over pairs of triangles (a,b,c) and (a,c,d), lane by lane. moments.c has the functions that use it. */
typedef struct dgfemi_moments {
    dgfem_real corner[12][DGFEM_LANES]; /* ax ay az bx .. dz, scaled; from the apex, then from the centre */
    dgfem_real weight[2][DGFEM_LANES];  /* of (a,b,c) and of (a,c,d) */
    dgfem_real layer[DGFEM_MOMENTS_LAYER][DGFEM_LANES];
    dgfem_real sum[DGFEM_MOMENTS_COUNT][DGFEM_LANES];
    const dgfem_vec3 *vertices;
    dgfem_vec3 centre, normal;
    dgfem_vec3 apex_position, apex; /* apex: from the centre, scaled */
    dgfem_real scale, inverse_power;
    int degree, face, lanes;
    int apex_vertex; /* DGFEM_NONE before the first loop */
    int waiting[3];  /* a triangle not yet in any pair; waiting[0] is DGFEM_NONE if there is none */
} dgfemi_moments;

/* sum[] += t of the pairs in corner[] with weight[], up to degree. The generator has the formulas. */
static void dgfemi_moments_recursion(dgfemi_moments *m) {
    int l;
    /* degrees 0 to 2 */
    for (l = 0; l < DGFEM_LANES; l++) {
        const dgfem_real ax = m->corner[0][l], ay = m->corner[1][l], az = m->corner[2][l];
        const dgfem_real bx = m->corner[3][l], by = m->corner[4][l], bz = m->corner[5][l];
        const dgfem_real cx = m->corner[6][l], cy = m->corner[7][l], cz = m->corner[8][l];
        const dgfem_real dx = m->corner[9][l], dy = m->corner[10][l], dz = m->corner[11][l];
        const dgfem_real by2 = 2 * by, dy2 = 2 * dy;
        const dgfem_real bz2 = 2 * bz, dz2 = 2 * dz;
        const dgfem_real p000 = m->weight[0][l];
        const dgfem_real q000 = m->weight[1][l];
        const dgfem_real c000 = p000 + q000;
        const dgfem_real t000 = c000;
        m->sum[0][l] += t000;
        const dgfem_real p100 = bx * p000;
        const dgfem_real q100 = dx * q000;
        const dgfem_real c100 = p100 + q100 + cx * c000;
        const dgfem_real t100 = c100 + ax * t000;
        m->sum[1][l] += t100;
        const dgfem_real p010 = by * p000;
        const dgfem_real q010 = dy * q000;
        const dgfem_real c010 = p010 + q010 + cy * c000;
        const dgfem_real t010 = c010 + ay * t000;
        m->sum[2][l] += t010;
        const dgfem_real p001 = bz * p000;
        const dgfem_real q001 = dz * q000;
        const dgfem_real c001 = p001 + q001 + cz * c000;
        const dgfem_real t001 = c001 + az * t000;
        m->sum[3][l] += t001;
        const dgfem_real p200 = bx * p100;
        const dgfem_real q200 = dx * q100;
        const dgfem_real c200 = p200 + q200 + cx * c100;
        const dgfem_real t200 = c200 + ax * t100;
        m->sum[4][l] += t200;
        const dgfem_real p110 = by2 * p100;
        const dgfem_real q110 = dy2 * q100;
        const dgfem_real c110 = p110 + q110 + cx * c010 + cy * c100;
        const dgfem_real t110 = c110 + ax * t010 + ay * t100;
        m->sum[5][l] += t110;
        const dgfem_real p101 = bz2 * p100;
        const dgfem_real q101 = dz2 * q100;
        const dgfem_real c101 = p101 + q101 + cx * c001 + cz * c100;
        const dgfem_real t101 = c101 + ax * t001 + az * t100;
        m->sum[6][l] += t101;
        const dgfem_real p020 = by * p010;
        const dgfem_real q020 = dy * q010;
        const dgfem_real c020 = p020 + q020 + cy * c010;
        const dgfem_real t020 = c020 + ay * t010;
        m->sum[7][l] += t020;
        const dgfem_real p011 = bz2 * p010;
        const dgfem_real q011 = dz2 * q010;
        const dgfem_real c011 = p011 + q011 + cy * c001 + cz * c010;
        const dgfem_real t011 = c011 + ay * t001 + az * t010;
        m->sum[8][l] += t011;
        const dgfem_real p002 = bz * p001;
        const dgfem_real q002 = dz * q001;
        const dgfem_real c002 = p002 + q002 + cz * c001;
        const dgfem_real t002 = c002 + az * t001;
        m->sum[9][l] += t002;
        m->layer[0][l] = p200;
        m->layer[1][l] = q200;
        m->layer[2][l] = c200;
        m->layer[3][l] = t200;
        m->layer[4][l] = p110;
        m->layer[5][l] = q110;
        m->layer[6][l] = c110;
        m->layer[7][l] = t110;
        m->layer[10][l] = c101;
        m->layer[11][l] = t101;
        m->layer[12][l] = p020;
        m->layer[13][l] = q020;
        m->layer[14][l] = c020;
        m->layer[15][l] = t020;
        m->layer[18][l] = c011;
        m->layer[19][l] = t011;
        m->layer[20][l] = p002;
        m->layer[21][l] = q002;
        m->layer[22][l] = c002;
        m->layer[23][l] = t002;
    }
    if (m->degree <= 2) return;
    /* degrees 3 to 4 */
    for (l = 0; l < DGFEM_LANES; l++) {
        const dgfem_real ax = m->corner[0][l], ay = m->corner[1][l], az = m->corner[2][l];
        const dgfem_real bx = m->corner[3][l], by = m->corner[4][l], bz = m->corner[5][l];
        const dgfem_real cx = m->corner[6][l], cy = m->corner[7][l], cz = m->corner[8][l];
        const dgfem_real dx = m->corner[9][l], dy = m->corner[10][l], dz = m->corner[11][l];
        const dgfem_real bx3 = 3 * bx, dx3 = 3 * dx;
        const dgfem_real bx4 = 4 * bx, dx4 = 4 * dx;
        const dgfem_real by2 = 2 * by, dy2 = 2 * dy;
        const dgfem_real by3 = 3 * by, dy3 = 3 * dy;
        const dgfem_real by4 = 4 * by, dy4 = 4 * dy;
        const dgfem_real bz2 = 2 * bz, dz2 = 2 * dz;
        const dgfem_real bz3 = 3 * bz, dz3 = 3 * dz;
        const dgfem_real bz4 = 4 * bz, dz4 = 4 * dz;
        const dgfem_real p200 = m->layer[0][l];
        const dgfem_real q200 = m->layer[1][l];
        const dgfem_real c200 = m->layer[2][l];
        const dgfem_real t200 = m->layer[3][l];
        const dgfem_real p110 = m->layer[4][l];
        const dgfem_real q110 = m->layer[5][l];
        const dgfem_real c110 = m->layer[6][l];
        const dgfem_real t110 = m->layer[7][l];
        const dgfem_real c101 = m->layer[10][l];
        const dgfem_real t101 = m->layer[11][l];
        const dgfem_real p020 = m->layer[12][l];
        const dgfem_real q020 = m->layer[13][l];
        const dgfem_real c020 = m->layer[14][l];
        const dgfem_real t020 = m->layer[15][l];
        const dgfem_real c011 = m->layer[18][l];
        const dgfem_real t011 = m->layer[19][l];
        const dgfem_real p002 = m->layer[20][l];
        const dgfem_real q002 = m->layer[21][l];
        const dgfem_real c002 = m->layer[22][l];
        const dgfem_real t002 = m->layer[23][l];
        const dgfem_real p300 = bx * p200;
        const dgfem_real q300 = dx * q200;
        const dgfem_real c300 = p300 + q300 + cx * c200;
        const dgfem_real t300 = c300 + ax * t200;
        m->sum[10][l] += t300;
        const dgfem_real p210 = by3 * p200;
        const dgfem_real q210 = dy3 * q200;
        const dgfem_real c210 = p210 + q210 + cx * c110 + cy * c200;
        const dgfem_real t210 = c210 + ax * t110 + ay * t200;
        m->sum[11][l] += t210;
        const dgfem_real p201 = bz3 * p200;
        const dgfem_real q201 = dz3 * q200;
        const dgfem_real c201 = p201 + q201 + cx * c101 + cz * c200;
        const dgfem_real t201 = c201 + ax * t101 + az * t200;
        m->sum[12][l] += t201;
        const dgfem_real p120 = bx3 * p020;
        const dgfem_real q120 = dx3 * q020;
        const dgfem_real c120 = p120 + q120 + cx * c020 + cy * c110;
        const dgfem_real t120 = c120 + ax * t020 + ay * t110;
        m->sum[13][l] += t120;
        const dgfem_real p111 = bz3 * p110;
        const dgfem_real q111 = dz3 * q110;
        const dgfem_real c111 = p111 + q111 + cx * c011 + cy * c101 + cz * c110;
        const dgfem_real t111 = c111 + ax * t011 + ay * t101 + az * t110;
        m->sum[14][l] += t111;
        const dgfem_real p102 = bx3 * p002;
        const dgfem_real q102 = dx3 * q002;
        const dgfem_real c102 = p102 + q102 + cx * c002 + cz * c101;
        const dgfem_real t102 = c102 + ax * t002 + az * t101;
        m->sum[15][l] += t102;
        const dgfem_real p030 = by * p020;
        const dgfem_real q030 = dy * q020;
        const dgfem_real c030 = p030 + q030 + cy * c020;
        const dgfem_real t030 = c030 + ay * t020;
        m->sum[16][l] += t030;
        const dgfem_real p021 = bz3 * p020;
        const dgfem_real q021 = dz3 * q020;
        const dgfem_real c021 = p021 + q021 + cy * c011 + cz * c020;
        const dgfem_real t021 = c021 + ay * t011 + az * t020;
        m->sum[17][l] += t021;
        const dgfem_real p012 = by3 * p002;
        const dgfem_real q012 = dy3 * q002;
        const dgfem_real c012 = p012 + q012 + cy * c002 + cz * c011;
        const dgfem_real t012 = c012 + ay * t002 + az * t011;
        m->sum[18][l] += t012;
        const dgfem_real p003 = bz * p002;
        const dgfem_real q003 = dz * q002;
        const dgfem_real c003 = p003 + q003 + cz * c002;
        const dgfem_real t003 = c003 + az * t002;
        m->sum[19][l] += t003;
        const dgfem_real p400 = bx * p300;
        const dgfem_real q400 = dx * q300;
        const dgfem_real c400 = p400 + q400 + cx * c300;
        const dgfem_real t400 = c400 + ax * t300;
        m->sum[20][l] += t400;
        const dgfem_real p310 = by4 * p300;
        const dgfem_real q310 = dy4 * q300;
        const dgfem_real c310 = p310 + q310 + cx * c210 + cy * c300;
        const dgfem_real t310 = c310 + ax * t210 + ay * t300;
        m->sum[21][l] += t310;
        const dgfem_real p301 = bz4 * p300;
        const dgfem_real q301 = dz4 * q300;
        const dgfem_real c301 = p301 + q301 + cx * c201 + cz * c300;
        const dgfem_real t301 = c301 + ax * t201 + az * t300;
        m->sum[22][l] += t301;
        const dgfem_real p220 = by2 * p210;
        const dgfem_real q220 = dy2 * q210;
        const dgfem_real c220 = p220 + q220 + cx * c120 + cy * c210;
        const dgfem_real t220 = c220 + ax * t120 + ay * t210;
        m->sum[23][l] += t220;
        const dgfem_real p211 = bz4 * p210;
        const dgfem_real q211 = dz4 * q210;
        const dgfem_real c211 = p211 + q211 + cx * c111 + cy * c201 + cz * c210;
        const dgfem_real t211 = c211 + ax * t111 + ay * t201 + az * t210;
        m->sum[24][l] += t211;
        const dgfem_real p202 = bz2 * p201;
        const dgfem_real q202 = dz2 * q201;
        const dgfem_real c202 = p202 + q202 + cx * c102 + cz * c201;
        const dgfem_real t202 = c202 + ax * t102 + az * t201;
        m->sum[25][l] += t202;
        const dgfem_real p130 = bx4 * p030;
        const dgfem_real q130 = dx4 * q030;
        const dgfem_real c130 = p130 + q130 + cx * c030 + cy * c120;
        const dgfem_real t130 = c130 + ax * t030 + ay * t120;
        m->sum[26][l] += t130;
        const dgfem_real p121 = bz4 * p120;
        const dgfem_real q121 = dz4 * q120;
        const dgfem_real c121 = p121 + q121 + cx * c021 + cy * c111 + cz * c120;
        const dgfem_real t121 = c121 + ax * t021 + ay * t111 + az * t120;
        m->sum[27][l] += t121;
        const dgfem_real p112 = bz2 * p111;
        const dgfem_real q112 = dz2 * q111;
        const dgfem_real c112 = p112 + q112 + cx * c012 + cy * c102 + cz * c111;
        const dgfem_real t112 = c112 + ax * t012 + ay * t102 + az * t111;
        m->sum[28][l] += t112;
        const dgfem_real p103 = bx4 * p003;
        const dgfem_real q103 = dx4 * q003;
        const dgfem_real c103 = p103 + q103 + cx * c003 + cz * c102;
        const dgfem_real t103 = c103 + ax * t003 + az * t102;
        m->sum[29][l] += t103;
        const dgfem_real p040 = by * p030;
        const dgfem_real q040 = dy * q030;
        const dgfem_real c040 = p040 + q040 + cy * c030;
        const dgfem_real t040 = c040 + ay * t030;
        m->sum[30][l] += t040;
        const dgfem_real p031 = bz4 * p030;
        const dgfem_real q031 = dz4 * q030;
        const dgfem_real c031 = p031 + q031 + cy * c021 + cz * c030;
        const dgfem_real t031 = c031 + ay * t021 + az * t030;
        m->sum[31][l] += t031;
        const dgfem_real p022 = bz2 * p021;
        const dgfem_real q022 = dz2 * q021;
        const dgfem_real c022 = p022 + q022 + cy * c012 + cz * c021;
        const dgfem_real t022 = c022 + ay * t012 + az * t021;
        m->sum[32][l] += t022;
        const dgfem_real p013 = by4 * p003;
        const dgfem_real q013 = dy4 * q003;
        const dgfem_real c013 = p013 + q013 + cy * c003 + cz * c012;
        const dgfem_real t013 = c013 + ay * t003 + az * t012;
        m->sum[33][l] += t013;
        const dgfem_real p004 = bz * p003;
        const dgfem_real q004 = dz * q003;
        const dgfem_real c004 = p004 + q004 + cz * c003;
        const dgfem_real t004 = c004 + az * t003;
        m->sum[34][l] += t004;
        m->layer[0][l] = p400;
        m->layer[1][l] = q400;
        m->layer[2][l] = c400;
        m->layer[3][l] = t400;
        m->layer[4][l] = p310;
        m->layer[5][l] = q310;
        m->layer[6][l] = c310;
        m->layer[7][l] = t310;
        m->layer[8][l] = p301;
        m->layer[9][l] = q301;
        m->layer[10][l] = c301;
        m->layer[11][l] = t301;
        m->layer[12][l] = p220;
        m->layer[13][l] = q220;
        m->layer[14][l] = c220;
        m->layer[15][l] = t220;
        m->layer[18][l] = c211;
        m->layer[19][l] = t211;
        m->layer[20][l] = p202;
        m->layer[21][l] = q202;
        m->layer[22][l] = c202;
        m->layer[23][l] = t202;
        m->layer[24][l] = p130;
        m->layer[25][l] = q130;
        m->layer[26][l] = c130;
        m->layer[27][l] = t130;
        m->layer[30][l] = c121;
        m->layer[31][l] = t121;
        m->layer[34][l] = c112;
        m->layer[35][l] = t112;
        m->layer[36][l] = p103;
        m->layer[37][l] = q103;
        m->layer[38][l] = c103;
        m->layer[39][l] = t103;
        m->layer[40][l] = p040;
        m->layer[41][l] = q040;
        m->layer[42][l] = c040;
        m->layer[43][l] = t040;
        m->layer[44][l] = p031;
        m->layer[45][l] = q031;
        m->layer[46][l] = c031;
        m->layer[47][l] = t031;
        m->layer[48][l] = p022;
        m->layer[49][l] = q022;
        m->layer[50][l] = c022;
        m->layer[51][l] = t022;
        m->layer[52][l] = p013;
        m->layer[53][l] = q013;
        m->layer[54][l] = c013;
        m->layer[55][l] = t013;
        m->layer[56][l] = p004;
        m->layer[57][l] = q004;
        m->layer[58][l] = c004;
        m->layer[59][l] = t004;
    }
    if (m->degree <= 4) return;
    /* degrees 5 to 6 */
    for (l = 0; l < DGFEM_LANES; l++) {
        const dgfem_real ax = m->corner[0][l], ay = m->corner[1][l], az = m->corner[2][l];
        const dgfem_real bx = m->corner[3][l], by = m->corner[4][l], bz = m->corner[5][l];
        const dgfem_real cx = m->corner[6][l], cy = m->corner[7][l], cz = m->corner[8][l];
        const dgfem_real dx = m->corner[9][l], dy = m->corner[10][l], dz = m->corner[11][l];
        const dgfem_real bx3 = 3 * bx, dx3 = 3 * dx;
        const dgfem_real bx5 = 5 * bx, dx5 = 5 * dx;
        const dgfem_real bx6 = 6 * bx, dx6 = 6 * dx;
        const dgfem_real by2 = 2 * by, dy2 = 2 * dy;
        const dgfem_real by3 = 3 * by, dy3 = 3 * dy;
        const dgfem_real by5 = 5 * by, dy5 = 5 * dy;
        const dgfem_real by6 = 6 * by, dy6 = 6 * dy;
        const dgfem_real bz2 = 2 * bz, dz2 = 2 * dz;
        const dgfem_real bz3 = 3 * bz, dz3 = 3 * dz;
        const dgfem_real bz5 = 5 * bz, dz5 = 5 * dz;
        const dgfem_real bz6 = 6 * bz, dz6 = 6 * dz;
        const dgfem_real p400 = m->layer[0][l];
        const dgfem_real q400 = m->layer[1][l];
        const dgfem_real c400 = m->layer[2][l];
        const dgfem_real t400 = m->layer[3][l];
        const dgfem_real p310 = m->layer[4][l];
        const dgfem_real q310 = m->layer[5][l];
        const dgfem_real c310 = m->layer[6][l];
        const dgfem_real t310 = m->layer[7][l];
        const dgfem_real p301 = m->layer[8][l];
        const dgfem_real q301 = m->layer[9][l];
        const dgfem_real c301 = m->layer[10][l];
        const dgfem_real t301 = m->layer[11][l];
        const dgfem_real p220 = m->layer[12][l];
        const dgfem_real q220 = m->layer[13][l];
        const dgfem_real c220 = m->layer[14][l];
        const dgfem_real t220 = m->layer[15][l];
        const dgfem_real c211 = m->layer[18][l];
        const dgfem_real t211 = m->layer[19][l];
        const dgfem_real p202 = m->layer[20][l];
        const dgfem_real q202 = m->layer[21][l];
        const dgfem_real c202 = m->layer[22][l];
        const dgfem_real t202 = m->layer[23][l];
        const dgfem_real p130 = m->layer[24][l];
        const dgfem_real q130 = m->layer[25][l];
        const dgfem_real c130 = m->layer[26][l];
        const dgfem_real t130 = m->layer[27][l];
        const dgfem_real c121 = m->layer[30][l];
        const dgfem_real t121 = m->layer[31][l];
        const dgfem_real c112 = m->layer[34][l];
        const dgfem_real t112 = m->layer[35][l];
        const dgfem_real p103 = m->layer[36][l];
        const dgfem_real q103 = m->layer[37][l];
        const dgfem_real c103 = m->layer[38][l];
        const dgfem_real t103 = m->layer[39][l];
        const dgfem_real p040 = m->layer[40][l];
        const dgfem_real q040 = m->layer[41][l];
        const dgfem_real c040 = m->layer[42][l];
        const dgfem_real t040 = m->layer[43][l];
        const dgfem_real p031 = m->layer[44][l];
        const dgfem_real q031 = m->layer[45][l];
        const dgfem_real c031 = m->layer[46][l];
        const dgfem_real t031 = m->layer[47][l];
        const dgfem_real p022 = m->layer[48][l];
        const dgfem_real q022 = m->layer[49][l];
        const dgfem_real c022 = m->layer[50][l];
        const dgfem_real t022 = m->layer[51][l];
        const dgfem_real p013 = m->layer[52][l];
        const dgfem_real q013 = m->layer[53][l];
        const dgfem_real c013 = m->layer[54][l];
        const dgfem_real t013 = m->layer[55][l];
        const dgfem_real p004 = m->layer[56][l];
        const dgfem_real q004 = m->layer[57][l];
        const dgfem_real c004 = m->layer[58][l];
        const dgfem_real t004 = m->layer[59][l];
        const dgfem_real p500 = bx * p400;
        const dgfem_real q500 = dx * q400;
        const dgfem_real c500 = p500 + q500 + cx * c400;
        const dgfem_real t500 = c500 + ax * t400;
        m->sum[35][l] += t500;
        const dgfem_real p410 = by5 * p400;
        const dgfem_real q410 = dy5 * q400;
        const dgfem_real c410 = p410 + q410 + cx * c310 + cy * c400;
        const dgfem_real t410 = c410 + ax * t310 + ay * t400;
        m->sum[36][l] += t410;
        const dgfem_real p401 = bz5 * p400;
        const dgfem_real q401 = dz5 * q400;
        const dgfem_real c401 = p401 + q401 + cx * c301 + cz * c400;
        const dgfem_real t401 = c401 + ax * t301 + az * t400;
        m->sum[37][l] += t401;
        const dgfem_real p320 = bx * p220 + by * p310;
        const dgfem_real q320 = dx * q220 + dy * q310;
        const dgfem_real c320 = p320 + q320 + cx * c220 + cy * c310;
        const dgfem_real t320 = c320 + ax * t220 + ay * t310;
        m->sum[38][l] += t320;
        const dgfem_real p311 = bz5 * p310;
        const dgfem_real q311 = dz5 * q310;
        const dgfem_real c311 = p311 + q311 + cx * c211 + cy * c301 + cz * c310;
        const dgfem_real t311 = c311 + ax * t211 + ay * t301 + az * t310;
        m->sum[39][l] += t311;
        const dgfem_real p302 = bx * p202 + bz * p301;
        const dgfem_real q302 = dx * q202 + dz * q301;
        const dgfem_real c302 = p302 + q302 + cx * c202 + cz * c301;
        const dgfem_real t302 = c302 + ax * t202 + az * t301;
        m->sum[40][l] += t302;
        const dgfem_real p230 = bx * p130 + by * p220;
        const dgfem_real q230 = dx * q130 + dy * q220;
        const dgfem_real c230 = p230 + q230 + cx * c130 + cy * c220;
        const dgfem_real t230 = c230 + ax * t130 + ay * t220;
        m->sum[41][l] += t230;
        const dgfem_real p221 = bz5 * p220;
        const dgfem_real q221 = dz5 * q220;
        const dgfem_real c221 = p221 + q221 + cx * c121 + cy * c211 + cz * c220;
        const dgfem_real t221 = c221 + ax * t121 + ay * t211 + az * t220;
        m->sum[42][l] += t221;
        const dgfem_real p212 = by5 * p202;
        const dgfem_real q212 = dy5 * q202;
        const dgfem_real c212 = p212 + q212 + cx * c112 + cy * c202 + cz * c211;
        const dgfem_real t212 = c212 + ax * t112 + ay * t202 + az * t211;
        m->sum[43][l] += t212;
        const dgfem_real p203 = bx * p103 + bz * p202;
        const dgfem_real q203 = dx * q103 + dz * q202;
        const dgfem_real c203 = p203 + q203 + cx * c103 + cz * c202;
        const dgfem_real t203 = c203 + ax * t103 + az * t202;
        m->sum[44][l] += t203;
        const dgfem_real p140 = bx5 * p040;
        const dgfem_real q140 = dx5 * q040;
        const dgfem_real c140 = p140 + q140 + cx * c040 + cy * c130;
        const dgfem_real t140 = c140 + ax * t040 + ay * t130;
        m->sum[45][l] += t140;
        const dgfem_real p131 = bz5 * p130;
        const dgfem_real q131 = dz5 * q130;
        const dgfem_real c131 = p131 + q131 + cx * c031 + cy * c121 + cz * c130;
        const dgfem_real t131 = c131 + ax * t031 + ay * t121 + az * t130;
        m->sum[46][l] += t131;
        const dgfem_real p122 = bx5 * p022;
        const dgfem_real q122 = dx5 * q022;
        const dgfem_real c122 = p122 + q122 + cx * c022 + cy * c112 + cz * c121;
        const dgfem_real t122 = c122 + ax * t022 + ay * t112 + az * t121;
        m->sum[47][l] += t122;
        const dgfem_real p113 = by5 * p103;
        const dgfem_real q113 = dy5 * q103;
        const dgfem_real c113 = p113 + q113 + cx * c013 + cy * c103 + cz * c112;
        const dgfem_real t113 = c113 + ax * t013 + ay * t103 + az * t112;
        m->sum[48][l] += t113;
        const dgfem_real p104 = bx5 * p004;
        const dgfem_real q104 = dx5 * q004;
        const dgfem_real c104 = p104 + q104 + cx * c004 + cz * c103;
        const dgfem_real t104 = c104 + ax * t004 + az * t103;
        m->sum[49][l] += t104;
        const dgfem_real p050 = by * p040;
        const dgfem_real q050 = dy * q040;
        const dgfem_real c050 = p050 + q050 + cy * c040;
        const dgfem_real t050 = c050 + ay * t040;
        m->sum[50][l] += t050;
        const dgfem_real p041 = bz5 * p040;
        const dgfem_real q041 = dz5 * q040;
        const dgfem_real c041 = p041 + q041 + cy * c031 + cz * c040;
        const dgfem_real t041 = c041 + ay * t031 + az * t040;
        m->sum[51][l] += t041;
        const dgfem_real p032 = by * p022 + bz * p031;
        const dgfem_real q032 = dy * q022 + dz * q031;
        const dgfem_real c032 = p032 + q032 + cy * c022 + cz * c031;
        const dgfem_real t032 = c032 + ay * t022 + az * t031;
        m->sum[52][l] += t032;
        const dgfem_real p023 = by * p013 + bz * p022;
        const dgfem_real q023 = dy * q013 + dz * q022;
        const dgfem_real c023 = p023 + q023 + cy * c013 + cz * c022;
        const dgfem_real t023 = c023 + ay * t013 + az * t022;
        m->sum[53][l] += t023;
        const dgfem_real p014 = by5 * p004;
        const dgfem_real q014 = dy5 * q004;
        const dgfem_real c014 = p014 + q014 + cy * c004 + cz * c013;
        const dgfem_real t014 = c014 + ay * t004 + az * t013;
        m->sum[54][l] += t014;
        const dgfem_real p005 = bz * p004;
        const dgfem_real q005 = dz * q004;
        const dgfem_real c005 = p005 + q005 + cz * c004;
        const dgfem_real t005 = c005 + az * t004;
        m->sum[55][l] += t005;
        const dgfem_real p600 = bx * p500;
        const dgfem_real q600 = dx * q500;
        const dgfem_real c600 = p600 + q600 + cx * c500;
        const dgfem_real t600 = c600 + ax * t500;
        m->sum[56][l] += t600;
        const dgfem_real p510 = by6 * p500;
        const dgfem_real q510 = dy6 * q500;
        const dgfem_real c510 = p510 + q510 + cx * c410 + cy * c500;
        const dgfem_real t510 = c510 + ax * t410 + ay * t500;
        m->sum[57][l] += t510;
        const dgfem_real p501 = bz6 * p500;
        const dgfem_real q501 = dz6 * q500;
        const dgfem_real c501 = p501 + q501 + cx * c401 + cz * c500;
        const dgfem_real t501 = c501 + ax * t401 + az * t500;
        m->sum[58][l] += t501;
        const dgfem_real p420 = by3 * p410;
        const dgfem_real q420 = dy3 * q410;
        const dgfem_real c420 = p420 + q420 + cx * c320 + cy * c410;
        const dgfem_real t420 = c420 + ax * t320 + ay * t410;
        m->sum[59][l] += t420;
        const dgfem_real p411 = bz6 * p410;
        const dgfem_real q411 = dz6 * q410;
        const dgfem_real c411 = p411 + q411 + cx * c311 + cy * c401 + cz * c410;
        const dgfem_real t411 = c411 + ax * t311 + ay * t401 + az * t410;
        m->sum[60][l] += t411;
        const dgfem_real p402 = bz3 * p401;
        const dgfem_real q402 = dz3 * q401;
        const dgfem_real c402 = p402 + q402 + cx * c302 + cz * c401;
        const dgfem_real t402 = c402 + ax * t302 + az * t401;
        m->sum[61][l] += t402;
        const dgfem_real p330 = by2 * p320;
        const dgfem_real q330 = dy2 * q320;
        const dgfem_real c330 = p330 + q330 + cx * c230 + cy * c320;
        const dgfem_real t330 = c330 + ax * t230 + ay * t320;
        m->sum[62][l] += t330;
        const dgfem_real p321 = bz6 * p320;
        const dgfem_real q321 = dz6 * q320;
        const dgfem_real c321 = p321 + q321 + cx * c221 + cy * c311 + cz * c320;
        const dgfem_real t321 = c321 + ax * t221 + ay * t311 + az * t320;
        m->sum[63][l] += t321;
        const dgfem_real p312 = bz3 * p311;
        const dgfem_real q312 = dz3 * q311;
        const dgfem_real c312 = p312 + q312 + cx * c212 + cy * c302 + cz * c311;
        const dgfem_real t312 = c312 + ax * t212 + ay * t302 + az * t311;
        m->sum[64][l] += t312;
        const dgfem_real p303 = bz2 * p302;
        const dgfem_real q303 = dz2 * q302;
        const dgfem_real c303 = p303 + q303 + cx * c203 + cz * c302;
        const dgfem_real t303 = c303 + ax * t203 + az * t302;
        m->sum[65][l] += t303;
        const dgfem_real p240 = bx3 * p140;
        const dgfem_real q240 = dx3 * q140;
        const dgfem_real c240 = p240 + q240 + cx * c140 + cy * c230;
        const dgfem_real t240 = c240 + ax * t140 + ay * t230;
        m->sum[66][l] += t240;
        const dgfem_real p231 = bz6 * p230;
        const dgfem_real q231 = dz6 * q230;
        const dgfem_real c231 = p231 + q231 + cx * c131 + cy * c221 + cz * c230;
        const dgfem_real t231 = c231 + ax * t131 + ay * t221 + az * t230;
        m->sum[67][l] += t231;
        const dgfem_real p222 = bz3 * p221;
        const dgfem_real q222 = dz3 * q221;
        const dgfem_real c222 = p222 + q222 + cx * c122 + cy * c212 + cz * c221;
        const dgfem_real t222 = c222 + ax * t122 + ay * t212 + az * t221;
        m->sum[68][l] += t222;
        const dgfem_real p213 = bz2 * p212;
        const dgfem_real q213 = dz2 * q212;
        const dgfem_real c213 = p213 + q213 + cx * c113 + cy * c203 + cz * c212;
        const dgfem_real t213 = c213 + ax * t113 + ay * t203 + az * t212;
        m->sum[69][l] += t213;
        const dgfem_real p204 = bx3 * p104;
        const dgfem_real q204 = dx3 * q104;
        const dgfem_real c204 = p204 + q204 + cx * c104 + cz * c203;
        const dgfem_real t204 = c204 + ax * t104 + az * t203;
        m->sum[70][l] += t204;
        const dgfem_real p150 = bx6 * p050;
        const dgfem_real q150 = dx6 * q050;
        const dgfem_real c150 = p150 + q150 + cx * c050 + cy * c140;
        const dgfem_real t150 = c150 + ax * t050 + ay * t140;
        m->sum[71][l] += t150;
        const dgfem_real p141 = bz6 * p140;
        const dgfem_real q141 = dz6 * q140;
        const dgfem_real c141 = p141 + q141 + cx * c041 + cy * c131 + cz * c140;
        const dgfem_real t141 = c141 + ax * t041 + ay * t131 + az * t140;
        m->sum[72][l] += t141;
        const dgfem_real p132 = bz3 * p131;
        const dgfem_real q132 = dz3 * q131;
        const dgfem_real c132 = p132 + q132 + cx * c032 + cy * c122 + cz * c131;
        const dgfem_real t132 = c132 + ax * t032 + ay * t122 + az * t131;
        m->sum[73][l] += t132;
        const dgfem_real p123 = bz2 * p122;
        const dgfem_real q123 = dz2 * q122;
        const dgfem_real c123 = p123 + q123 + cx * c023 + cy * c113 + cz * c122;
        const dgfem_real t123 = c123 + ax * t023 + ay * t113 + az * t122;
        m->sum[74][l] += t123;
        const dgfem_real p114 = by6 * p104;
        const dgfem_real q114 = dy6 * q104;
        const dgfem_real c114 = p114 + q114 + cx * c014 + cy * c104 + cz * c113;
        const dgfem_real t114 = c114 + ax * t014 + ay * t104 + az * t113;
        m->sum[75][l] += t114;
        const dgfem_real p105 = bx6 * p005;
        const dgfem_real q105 = dx6 * q005;
        const dgfem_real c105 = p105 + q105 + cx * c005 + cz * c104;
        const dgfem_real t105 = c105 + ax * t005 + az * t104;
        m->sum[76][l] += t105;
        const dgfem_real p060 = by * p050;
        const dgfem_real q060 = dy * q050;
        const dgfem_real c060 = p060 + q060 + cy * c050;
        const dgfem_real t060 = c060 + ay * t050;
        m->sum[77][l] += t060;
        const dgfem_real p051 = bz6 * p050;
        const dgfem_real q051 = dz6 * q050;
        const dgfem_real c051 = p051 + q051 + cy * c041 + cz * c050;
        const dgfem_real t051 = c051 + ay * t041 + az * t050;
        m->sum[78][l] += t051;
        const dgfem_real p042 = bz3 * p041;
        const dgfem_real q042 = dz3 * q041;
        const dgfem_real c042 = p042 + q042 + cy * c032 + cz * c041;
        const dgfem_real t042 = c042 + ay * t032 + az * t041;
        m->sum[79][l] += t042;
        const dgfem_real p033 = bz2 * p032;
        const dgfem_real q033 = dz2 * q032;
        const dgfem_real c033 = p033 + q033 + cy * c023 + cz * c032;
        const dgfem_real t033 = c033 + ay * t023 + az * t032;
        m->sum[80][l] += t033;
        const dgfem_real p024 = by3 * p014;
        const dgfem_real q024 = dy3 * q014;
        const dgfem_real c024 = p024 + q024 + cy * c014 + cz * c023;
        const dgfem_real t024 = c024 + ay * t014 + az * t023;
        m->sum[81][l] += t024;
        const dgfem_real p015 = by6 * p005;
        const dgfem_real q015 = dy6 * q005;
        const dgfem_real c015 = p015 + q015 + cy * c005 + cz * c014;
        const dgfem_real t015 = c015 + ay * t005 + az * t014;
        m->sum[82][l] += t015;
        const dgfem_real p006 = bz * p005;
        const dgfem_real q006 = dz * q005;
        const dgfem_real c006 = p006 + q006 + cz * c005;
        const dgfem_real t006 = c006 + az * t005;
        m->sum[83][l] += t006;
    }
}

/* The factor of the apex o, for the sum over all tetrahedra. */
static void dgfemi_moments_apply_apex(int degree, dgfem_vec3 o, dgfem_real *total) {
    if (degree < 1) return;
    total[1] += o.x * total[0];
    total[2] += o.y * total[0];
    total[3] += o.z * total[0];
    if (degree < 2) return;
    total[4] += o.x * total[1];
    total[5] += o.x * total[2] + o.y * total[1];
    total[6] += o.x * total[3] + o.z * total[1];
    total[7] += o.y * total[2];
    total[8] += o.y * total[3] + o.z * total[2];
    total[9] += o.z * total[3];
    if (degree < 3) return;
    total[10] += o.x * total[4];
    total[11] += o.x * total[5] + o.y * total[4];
    total[12] += o.x * total[6] + o.z * total[4];
    total[13] += o.x * total[7] + o.y * total[5];
    total[14] += o.x * total[8] + o.y * total[6] + o.z * total[5];
    total[15] += o.x * total[9] + o.z * total[6];
    total[16] += o.y * total[7];
    total[17] += o.y * total[8] + o.z * total[7];
    total[18] += o.y * total[9] + o.z * total[8];
    total[19] += o.z * total[9];
    if (degree < 4) return;
    total[20] += o.x * total[10];
    total[21] += o.x * total[11] + o.y * total[10];
    total[22] += o.x * total[12] + o.z * total[10];
    total[23] += o.x * total[13] + o.y * total[11];
    total[24] += o.x * total[14] + o.y * total[12] + o.z * total[11];
    total[25] += o.x * total[15] + o.z * total[12];
    total[26] += o.x * total[16] + o.y * total[13];
    total[27] += o.x * total[17] + o.y * total[14] + o.z * total[13];
    total[28] += o.x * total[18] + o.y * total[15] + o.z * total[14];
    total[29] += o.x * total[19] + o.z * total[15];
    total[30] += o.y * total[16];
    total[31] += o.y * total[17] + o.z * total[16];
    total[32] += o.y * total[18] + o.z * total[17];
    total[33] += o.y * total[19] + o.z * total[18];
    total[34] += o.z * total[19];
    if (degree < 5) return;
    total[35] += o.x * total[20];
    total[36] += o.x * total[21] + o.y * total[20];
    total[37] += o.x * total[22] + o.z * total[20];
    total[38] += o.x * total[23] + o.y * total[21];
    total[39] += o.x * total[24] + o.y * total[22] + o.z * total[21];
    total[40] += o.x * total[25] + o.z * total[22];
    total[41] += o.x * total[26] + o.y * total[23];
    total[42] += o.x * total[27] + o.y * total[24] + o.z * total[23];
    total[43] += o.x * total[28] + o.y * total[25] + o.z * total[24];
    total[44] += o.x * total[29] + o.z * total[25];
    total[45] += o.x * total[30] + o.y * total[26];
    total[46] += o.x * total[31] + o.y * total[27] + o.z * total[26];
    total[47] += o.x * total[32] + o.y * total[28] + o.z * total[27];
    total[48] += o.x * total[33] + o.y * total[29] + o.z * total[28];
    total[49] += o.x * total[34] + o.z * total[29];
    total[50] += o.y * total[30];
    total[51] += o.y * total[31] + o.z * total[30];
    total[52] += o.y * total[32] + o.z * total[31];
    total[53] += o.y * total[33] + o.z * total[32];
    total[54] += o.y * total[34] + o.z * total[33];
    total[55] += o.z * total[34];
    if (degree < 6) return;
    total[56] += o.x * total[35];
    total[57] += o.x * total[36] + o.y * total[35];
    total[58] += o.x * total[37] + o.z * total[35];
    total[59] += o.x * total[38] + o.y * total[36];
    total[60] += o.x * total[39] + o.y * total[37] + o.z * total[36];
    total[61] += o.x * total[40] + o.z * total[37];
    total[62] += o.x * total[41] + o.y * total[38];
    total[63] += o.x * total[42] + o.y * total[39] + o.z * total[38];
    total[64] += o.x * total[43] + o.y * total[40] + o.z * total[39];
    total[65] += o.x * total[44] + o.z * total[40];
    total[66] += o.x * total[45] + o.y * total[41];
    total[67] += o.x * total[46] + o.y * total[42] + o.z * total[41];
    total[68] += o.x * total[47] + o.y * total[43] + o.z * total[42];
    total[69] += o.x * total[48] + o.y * total[44] + o.z * total[43];
    total[70] += o.x * total[49] + o.z * total[44];
    total[71] += o.x * total[50] + o.y * total[45];
    total[72] += o.x * total[51] + o.y * total[46] + o.z * total[45];
    total[73] += o.x * total[52] + o.y * total[47] + o.z * total[46];
    total[74] += o.x * total[53] + o.y * total[48] + o.z * total[47];
    total[75] += o.x * total[54] + o.y * total[49] + o.z * total[48];
    total[76] += o.x * total[55] + o.z * total[49];
    total[77] += o.y * total[50];
    total[78] += o.y * total[51] + o.z * total[50];
    total[79] += o.y * total[52] + o.z * total[51];
    total[80] += o.y * total[53] + o.z * total[52];
    total[81] += o.y * total[54] + o.z * total[53];
    total[82] += o.y * total[55] + o.z * total[54];
    total[83] += o.z * total[55];
}

/* out[n] = total of sum[n] * factors[n] * scale * ratio^(degree of n) */
static void dgfemi_moments_finish(const dgfemi_moments *m, const dgfem_real *factors, dgfem_real scale,
                                  dgfem_real ratio, dgfem_real *out) {
    dgfem_real total[DGFEM_MOMENTS_COUNT];
    const int degree = m->degree;
    int n;
    for (n = 0; n < 1; n++) total[n] = dgfemi_moments_lane_total(m->sum[n]);
    if (degree >= 1)
        for (n = 1; n < 4; n++) total[n] = dgfemi_moments_lane_total(m->sum[n]);
    if (degree >= 2)
        for (n = 4; n < 10; n++) total[n] = dgfemi_moments_lane_total(m->sum[n]);
    if (degree >= 3)
        for (n = 10; n < 20; n++) total[n] = dgfemi_moments_lane_total(m->sum[n]);
    if (degree >= 4)
        for (n = 20; n < 35; n++) total[n] = dgfemi_moments_lane_total(m->sum[n]);
    if (degree >= 5)
        for (n = 35; n < 56; n++) total[n] = dgfemi_moments_lane_total(m->sum[n]);
    if (degree >= 6)
        for (n = 56; n < 84; n++) total[n] = dgfemi_moments_lane_total(m->sum[n]);
    if (!m->face) dgfemi_moments_apply_apex(degree, m->apex, total);
    for (n = 0; n < 1; n++) out[n] = total[n] * factors[n] * scale;
    if (degree < 1) return;
    scale *= ratio;
    for (n = 1; n < 4; n++) out[n] = total[n] * factors[n] * scale;
    if (degree < 2) return;
    scale *= ratio;
    for (n = 4; n < 10; n++) out[n] = total[n] * factors[n] * scale;
    if (degree < 3) return;
    scale *= ratio;
    for (n = 10; n < 20; n++) out[n] = total[n] * factors[n] * scale;
    if (degree < 4) return;
    scale *= ratio;
    for (n = 20; n < 35; n++) out[n] = total[n] * factors[n] * scale;
    if (degree < 5) return;
    scale *= ratio;
    for (n = 35; n < 56; n++) out[n] = total[n] * factors[n] * scale;
    if (degree < 6) return;
    scale *= ratio;
    for (n = 56; n < 84; n++) out[n] = total[n] * factors[n] * scale;
}

#if DGFEM_MOMENTS_DEGREE < DGFEM_MAX_MOMENT_DEGREE
#error "dgfem: moments_generated.c was made for too low a degree"
#endif

/* ---- accumulation: begin, then the loops in any order, then end ---- */

static void dgfemi_moments_begin(dgfemi_moments *m, int degree, dgfem_vec3 centre, dgfem_real h) {
    int exponent;
    DGFEM_ASSERT(0 <= degree && degree <= DGFEM_MOMENTS_DEGREE && h > 0 && dgfemi_is_finite(h));
    (void)frexp((double)h, &exponent);
    m->degree = degree;
    m->centre = centre;
    m->scale = h;
    m->inverse_power = (dgfem_real)ldexp(1.0, -exponent);
    m->lanes = 0;
    m->face = 0;
    m->apex_vertex = m->waiting[0] = DGFEM_NONE;
    m->apex = dgfemi_vec3(0, 0, 0);
    memset(m->corner, 0, sizeof m->corner);
    memset(m->sum, 0, (size_t)dgfem_monomial_count(degree) * sizeof m->sum[0]);
}

/* Integrals of ((x - centre)/h)^(i,j,k), i + j + k <= degree, over the interior of a closed surface whose loops run
   counter-clockwise seen from outside. h > 0 of about the size of the object. All loops must follow before the end:
   sums over parts of a surface mean nothing. */
static void dgfemi_moments_begin_volume(dgfemi_moments *m, int degree, dgfem_vec3 centre, dgfem_real h) {
    dgfemi_moments_begin(m, degree, centre, h);
}

/* The same over a planar polygon whose loops run counter-clockwise about the unit normal. */
static void dgfemi_moments_begin_face(dgfemi_moments *m, int degree, dgfem_vec3 centre, dgfem_real h,
                                      dgfem_vec3 normal) {
    dgfemi_moments_begin(m, degree, centre, h);
    m->face = 1;
    m->normal = normal;
}

/* Results of (x - centre)^(i,j,k) instead; h then is only a hint. */
static void dgfemi_moments_unscaled(dgfemi_moments *m) { m->scale = 1; }

/* ---- weights: the volumes and areas of the simplices ---- */

#if !DGFEM_REAL_IS_FLOAT
/* a (b c' - b' c), a term of the determinant below, as result + *error. */
static double dgfemi_minor_term(double a, double b, double c1, double b1, double c, double *error) {
    double e1, e2, e3, e4;
    const double p = dgfemi_two_product(b, c1, &e1), q = dgfemi_two_product(b1, c, &e2);
    const double minor = dgfemi_two_sum(p, -q, &e3);
    const double term = dgfemi_two_product(a, minor, &e4);
    *error = e4 + a * (e3 + (e1 - e2));
    return term;
}
#endif

/* a.(b x c), as if computed with twice the digits. Flat elements that lie obliquely need it: with plain arithmetic the
   rounding errors, about 1e-16 |a| |b| |c|, could be as large as their volume. */
static dgfem_real dgfemi_triple_product(dgfem_vec3 a, dgfem_vec3 b, dgfem_vec3 c) {
#if DGFEM_REAL_IS_FLOAT
    const double ax = (double)a.x, ay = (double)a.y, az = (double)a.z, bx = (double)b.x, by = (double)b.y;
    const double bz = (double)b.z, cx = (double)c.x, cy = (double)c.y, cz = (double)c.z;
    return (dgfem_real)(ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx));
#else
    double ex, ey, ez, e1, e2, sum;
    const double x = dgfemi_minor_term(a.x, b.y, c.z, b.z, c.y, &ex);
    const double y = dgfemi_minor_term(a.y, b.z, c.x, b.x, c.z, &ey);
    const double z = dgfemi_minor_term(a.z, b.x, c.y, b.y, c.x, &ez);
    sum = dgfemi_two_sum(x, y, &e1);
    sum = dgfemi_two_sum(sum, z, &e2);
    return sum + ((e1 + e2) + (ex + ey + ez));
#endif
}

static dgfem_vec3 dgfemi_moments_corner(const dgfemi_moments *m, int corner, int l) {
    return dgfemi_vec3(m->corner[3 * corner][l], m->corner[3 * corner + 1][l], m->corner[3 * corner + 2][l]);
}

/* Six times the volumes of (o,a,b,c) and (o,a,c,d), o the origin of corner[]:
   a.(b x c) = -b.n and a.(c x d) = d.n with n = a x c.
   Where the terms of either sum (squared: size0, size1) exceed the sum itself by far, again with more digits. */
static void dgfemi_moments_volume_weights(dgfemi_moments *m) {
    const dgfem_real much = 64 * 64;
    dgfem_real doubt[DGFEM_LANES];
    int l;
    for (l = 0; l < DGFEM_LANES; l++) {
        const dgfem_real ax = m->corner[0][l], ay = m->corner[1][l], az = m->corner[2][l];
        const dgfem_real bx = m->corner[3][l], by = m->corner[4][l], bz = m->corner[5][l];
        const dgfem_real cx = m->corner[6][l], cy = m->corner[7][l], cz = m->corner[8][l];
        const dgfem_real dx = m->corner[9][l], dy = m->corner[10][l], dz = m->corner[11][l];
        const dgfem_real yz = ay * cz, zy = az * cy, zx = az * cx, xz = ax * cz, xy = ax * cy, yx = ay * cx;
        const dgfem_real nx = yz - zy, ny = zx - xz, nz = xy - yx;
        const dgfem_real w0 = -(bx * nx + by * ny + bz * nz), w1 = dx * nx + dy * ny + dz * nz;
        const dgfem_real sx = yz * yz + zy * zy, sy = zx * zx + xz * xz, sz = xy * xy + yx * yx;
        const dgfem_real size0 = bx * bx * sx + by * by * sy + bz * bz * sz;
        const dgfem_real size1 = dx * dx * sx + dy * dy * sy + dz * dz * sz;
        const dgfem_real doubt0 = size0 - much * w0 * w0, doubt1 = size1 - much * w1 * w1;
        m->weight[0][l] = w0;
        m->weight[1][l] = w1;
        doubt[l] = doubt0 > doubt1 ? doubt0 : doubt1;
    }
    for (l = 0; l < m->lanes; l++)
        if (doubt[l] > 0) {
            const dgfem_vec3 a = dgfemi_moments_corner(m, 0, l), c = dgfemi_moments_corner(m, 2, l);
            m->weight[0][l] = dgfemi_triple_product(a, dgfemi_moments_corner(m, 1, l), c);
            m->weight[1][l] = dgfemi_triple_product(a, c, dgfemi_moments_corner(m, 3, l));
        }
}

/* Twice the signed areas of (o,b,c) and (o,c,d). */
static void dgfemi_moments_face_weights(dgfemi_moments *m) {
    const dgfem_real nx = m->normal.x, ny = m->normal.y, nz = m->normal.z;
    int l;
    for (l = 0; l < DGFEM_LANES; l++) {
        const dgfem_real bx = m->corner[3][l], by = m->corner[4][l], bz = m->corner[5][l];
        const dgfem_real cx = m->corner[6][l], cy = m->corner[7][l], cz = m->corner[8][l];
        const dgfem_real dx = m->corner[9][l], dy = m->corner[10][l], dz = m->corner[11][l];
        m->weight[0][l] = nx * (by * cz - bz * cy) + ny * (bz * cx - bx * cz) + nz * (bx * cy - by * cx);
        m->weight[1][l] = nx * (cy * dz - cz * dy) + ny * (cz * dx - cx * dz) + nz * (cx * dy - cy * dx);
    }
}

/* Lanes that were not filled keep some earlier corners, or zeros; their weight must be zero. */
static void dgfemi_moments_flush(dgfemi_moments *m) {
    int n, l;
    if (m->face) dgfemi_moments_face_weights(m);
    else dgfemi_moments_volume_weights(m);
    for (l = m->lanes; l < DGFEM_LANES; l++) m->weight[0][l] = m->weight[1][l] = 0;
    for (n = 0; n < 12; n += 3)
        for (l = 0; l < DGFEM_LANES; l++) {
            m->corner[n][l] += m->apex.x;
            m->corner[n + 1][l] += m->apex.y;
            m->corner[n + 2][l] += m->apex.z;
        }
    dgfemi_moments_recursion(m);
    m->lanes = 0;
}

/* The vertex (DGFEM_NONE: the apex) as corner 0..3 of the pair in lane l, from the apex, scaled. */
static void dgfemi_moments_set_corner(dgfemi_moments *m, int corner, int l, int vertex) {
    dgfem_vec3 p = dgfemi_vec3(0, 0, 0);
    if (vertex != DGFEM_NONE) p = dgfemi_scale(m->inverse_power, dgfemi_sub(m->vertices[vertex], m->apex_position));
    m->corner[3 * corner][l] = p.x, m->corner[3 * corner + 1][l] = p.y, m->corner[3 * corner + 2][l] = p.z;
}

/* The triangles (a,b,c) and (a,c,d); d may be DGFEM_NONE, which gives the second no volume and no area. */
static void dgfemi_moments_push(dgfemi_moments *m, int a, int b, int c, int d) {
    const int l = m->lanes++;
    dgfemi_moments_set_corner(m, 0, l, a);
    dgfemi_moments_set_corner(m, 1, l, b);
    dgfemi_moments_set_corner(m, 2, l, c);
    dgfemi_moments_set_corner(m, 3, l, d);
    if (m->lanes == DGFEM_LANES) dgfemi_moments_flush(m);
}

/* A triangle without a neighbour in its loop, as all faces of a triangle mesh are: the last one waits for a triangle
   that shares an edge with it. */
static void dgfemi_moments_push_single(dgfemi_moments *m, int a, int b, int c) {
    int *w = m->waiting, t[3], i, k;
    t[0] = a, t[1] = b, t[2] = c;
    for (i = 0; i < 3 && w[0] != DGFEM_NONE; i++)
        for (k = 0; k < 3; k++)
            if (t[i] == w[(k + 1) % 3] && t[(i + 1) % 3] == w[k]) {
                dgfemi_moments_push(m, t[i], w[(k + 2) % 3], t[(i + 1) % 3], t[(i + 2) % 3]);
                w[0] = DGFEM_NONE;
                return;
            }
    if (w[0] != DGFEM_NONE) dgfemi_moments_push(m, w[0], w[1], w[2], DGFEM_NONE);
    w[0] = a, w[1] = b, w[2] = c;
}

/* The fan from a through the path loop[first], ..., loop[last - 1], where loop[count] means loop[0] again. */
static void dgfemi_moments_fan(dgfemi_moments *m, int a, const int *loop, int count, int first, int last, int reverse) {
    int i;
    for (i = first + 1; i < last; i += 2) {
        const int b = loop[i - 1], c = loop[i < count ? i : 0];
        if (i + 1 < last) {
            const int d = loop[i + 1 < count ? i + 1 : 0];
            dgfemi_moments_push(m, a, reverse ? d : b, c, reverse ? b : d);
        } else if (m->face) {
            dgfemi_moments_push(m, a, reverse ? c : b, reverse ? b : c, DGFEM_NONE);
        } else {
            dgfemi_moments_push_single(m, a, reverse ? c : b, reverse ? b : c);
        }
    }
}

/* One loop, planar, of vertex indices; reverse != 0 runs it backwards, as a face is seen from its other side. All loops
   between begin and end must index the same vertices. */
static void dgfemi_moments_loop(dgfemi_moments *m, const dgfem_vec3 *vertices, const int *loop, int count,
                                int reverse) {
    int i;
    if (count < 3) return;
    if (m->apex_vertex == DGFEM_NONE) {
        m->vertices = vertices;
        m->apex_vertex = loop[0];
        m->apex_position = vertices[loop[0]];
        m->apex = dgfemi_scale(m->inverse_power, dgfemi_sub(m->apex_position, m->centre));
    }
    DGFEM_ASSERT(m->vertices == vertices);
    if (m->face) {
        const int skip = loop[0] == m->apex_vertex; /* its two edges have no area */
        dgfemi_moments_fan(m, DGFEM_NONE, loop, count, skip, count + 1 - skip, reverse);
        return;
    }
    for (i = 0; i < count; i++)
        if (loop[i] == m->apex_vertex) return; /* a fan from the apex has no volume */
    dgfemi_moments_fan(m, loop[0], loop, count, 1, count, reverse);
}

/* out[dgfem_monomial_count(degree)], in the caller's scale h. */
static void dgfemi_moments_end(dgfemi_moments *m, dgfem_real *out) {
    const dgfem_real power = 1 / m->inverse_power, ratio = power / m->scale;
    if (m->waiting[0] != DGFEM_NONE) dgfemi_moments_push(m, m->waiting[0], m->waiting[1], m->waiting[2], DGFEM_NONE);
    if (m->lanes > 0) dgfemi_moments_flush(m);
    if (m->face) dgfemi_moments_finish(m, dgfemi_face_factors, power * power, ratio, out);
    else dgfemi_moments_finish(m, dgfemi_volume_factors, power * power * power, ratio, out);
}

/* ==== polyhedron.c ================================================================================================ */

/* The stand-alone polyhedron: creation, check, measure, contains, moments, triangles of its faces, components. */

/* ---- creation ---- */

DGFEM_API dgfem_polyhedron_desc dgfem_default_polyhedron_desc(void) {
    dgfem_polyhedron_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    return desc;
}

/* A polyhedron with room for these numbers of things, its arrays not yet filled; NULL when out of memory. */
static dgfem_polyhedron *dgfemi_polyhedron_allocate(const dgfem_hooks *hooks, int vertices, int faces, int loops,
                                                    int corners) {
    dgfem_polyhedron *p = (dgfem_polyhedron *)dgfemi_allocate_zero(hooks, 1, sizeof *p);
    if (!p) return NULL;
    p->hooks = *hooks;
    p->vertex_count = vertices;
    p->face_count = faces;
    p->vertices = (dgfem_vec3 *)dgfemi_allocate(hooks, (size_t)vertices, sizeof *p->vertices);
    p->face_loops = (int *)dgfemi_allocate(hooks, (size_t)faces + 1, sizeof(int));
    p->loop_start = (int *)dgfemi_allocate(hooks, (size_t)loops + 1, sizeof(int));
    p->loop_vertices = (int *)dgfemi_allocate(hooks, (size_t)corners, sizeof(int));
    if (p->vertices && p->face_loops && p->loop_start && p->loop_vertices) return p;
    dgfem_polyhedron_destroy(p);
    return NULL;
}

DGFEM_API void dgfem_polyhedron_destroy(dgfem_polyhedron *polyhedron) {
    dgfem_hooks hooks;
    if (!polyhedron) return;
    hooks = polyhedron->hooks;
    dgfemi_free(&hooks, polyhedron->vertices);
    dgfemi_free(&hooks, polyhedron->face_loops);
    dgfemi_free(&hooks, polyhedron->loop_start);
    dgfemi_free(&hooks, polyhedron->loop_vertices);
    dgfemi_free(&hooks, polyhedron);
}

static dgfem_status dgfemi_check_polyhedron_faces(const dgfem_polyhedron_desc *desc, int *loop_count) {
    int f;
    *loop_count = desc->face_count;
    if (!desc->face_loops) return DGFEM_OK;
    if (desc->face_loops[0] != 0)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "face_loops starts with %d, not 0", desc->face_loops[0]);
    for (f = 0; f < desc->face_count; f++)
        if (desc->face_loops[f + 1] <= desc->face_loops[f])
            return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "face %d has no loop: face_loops goes from %d to %d",
                               f, desc->face_loops[f], desc->face_loops[f + 1]);
    *loop_count = desc->face_loops[desc->face_count];
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_polyhedron_loop(const dgfem_polyhedron_desc *desc, int l) {
    const int start = desc->loop_start[l], end = desc->loop_start[l + 1];
    int i;
    if (end < start)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "loop %d: loop_start goes from %d to %d", l, start, end);
    if (end - start < 3)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_DEGENERATE, "loop %d has %d vertices", l, end - start);
    for (i = start; i < end; i++) {
        const int vertex = desc->loop_vertices[i], next = desc->loop_vertices[i + 1 < end ? i + 1 : start];
        if (vertex < 0 || vertex >= desc->vertex_count)
            return dgfemi_fail(&desc->hooks, DGFEM_ERROR_INDEX, "loop %d has vertex %d of %d", l, vertex,
                               desc->vertex_count);
        if (vertex == next)
            return dgfemi_fail(&desc->hooks, DGFEM_ERROR_DEGENERATE, "loop %d has vertex %d twice in a row", l, vertex);
    }
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_polyhedron_desc(const dgfem_polyhedron_desc *desc, int *loop_count) {
    const dgfem_hooks *hooks = &desc->hooks;
    dgfem_status status;
    int v, l;
    if (desc->vertex_count < 0 || desc->face_count < 0)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "polyhedron: negative number of vertices (%d) or faces (%d)",
                           desc->vertex_count, desc->face_count);
    if (desc->vertex_count == 0 || desc->face_count == 0)
        return dgfemi_fail(hooks, DGFEM_ERROR_EMPTY, "polyhedron of %d vertices and %d faces", desc->vertex_count,
                           desc->face_count);
    if (!desc->vertices || !desc->loop_start || !desc->loop_vertices)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "polyhedron: vertices, loop_start or loop_vertices is NULL");
    for (v = 0; v < desc->vertex_count; v++)
        if (!dgfemi_is_finite3(desc->vertices[v])) return dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "vertex %d", v);
    status = dgfemi_check_polyhedron_faces(desc, loop_count);
    if (status) return status;
    if (desc->loop_start[0] != 0)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "loop_start starts with %d, not 0", desc->loop_start[0]);
    for (l = 0; l < *loop_count; l++) {
        status = dgfemi_check_polyhedron_loop(desc, l);
        if (status) return status;
    }
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_polyhedron_create(const dgfem_polyhedron_desc *desc, dgfem_polyhedron **out) {
    dgfem_polyhedron *p;
    dgfem_status status;
    int loop_count = 0, corners, f;
    if (out) *out = NULL;
    status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (status) return status;
    if (!out) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "polyhedron: nowhere to put it");
    status = dgfemi_check_polyhedron_desc(desc, &loop_count);
    if (status) return status;
    corners = desc->loop_start[loop_count];
    p = dgfemi_polyhedron_allocate(&desc->hooks, desc->vertex_count, desc->face_count, loop_count, corners);
    if (!p) return dgfemi_fail_memory(&desc->hooks);
    memcpy(p->vertices, desc->vertices, (size_t)desc->vertex_count * sizeof *p->vertices);
    memcpy(p->loop_start, desc->loop_start, (size_t)(loop_count + 1) * sizeof(int));
    memcpy(p->loop_vertices, desc->loop_vertices, (size_t)corners * sizeof(int));
    for (f = 0; f <= desc->face_count; f++) p->face_loops[f] = desc->face_loops ? desc->face_loops[f] : f;
    *out = p;
    return DGFEM_OK;
}

/* ---- faces ---- */

static const int *dgfemi_polyhedron_loop(const dgfem_polyhedron *p, int loop, int *count) {
    *count = p->loop_start[loop + 1] - p->loop_start[loop];
    return p->loop_vertices + p->loop_start[loop];
}

/* Twice the vector area of a face. */
static dgfem_vec3 dgfemi_polyhedron_vector_area(const dgfem_polyhedron *p, int face) {
    dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
    int l, count;
    for (l = p->face_loops[face]; l < p->face_loops[face + 1]; l++) {
        const int *loop = dgfemi_polyhedron_loop(p, l, &count);
        sum = dgfemi_add(sum, dgfemi_loop_vector_area(p->vertices, loop, count));
    }
    return sum;
}

/* First corner of a face, and one past its last. */
static int dgfemi_polyhedron_first_corner(const dgfem_polyhedron *p, int face) {
    return p->loop_start[p->face_loops[face]];
}

/* The box of the vertices that occur in loops. */
static void dgfemi_polyhedron_box(const dgfem_polyhedron *p, dgfem_vec3 *lower, dgfem_vec3 *upper) {
    const int corners = dgfemi_polyhedron_first_corner(p, p->face_count);
    int i;
    *lower = *upper = p->vertices[p->loop_vertices[0]];
    for (i = 1; i < corners; i++) {
        *lower = dgfemi_min3(*lower, p->vertices[p->loop_vertices[i]]);
        *upper = dgfemi_max3(*upper, p->vertices[p->loop_vertices[i]]);
    }
}

/* ---- moments ---- */

/* A length scale for moments about the centre: the largest coordinate difference; 1 if all are zero. In double any will
   do, since no power of a sensible length overflows. */
static dgfem_real dgfemi_polyhedron_reach(const dgfem_polyhedron *p, dgfem_vec3 centre, int first_face, int end_face) {
#if DGFEM_REAL_IS_FLOAT
    const int end = dgfemi_polyhedron_first_corner(p, end_face);
    dgfem_real reach = 0;
    int i;
    for (i = dgfemi_polyhedron_first_corner(p, first_face); i < end; i++) {
        const dgfem_vec3 d = dgfemi_sub(p->vertices[p->loop_vertices[i]], centre);
        reach = dgfemi_max(reach, dgfemi_max(dgfemi_abs(d.x), dgfemi_max(dgfemi_abs(d.y), dgfemi_abs(d.z))));
    }
    return reach > 0 && dgfemi_is_finite(reach) ? reach : 1;
#else
    (void)p, (void)centre, (void)first_face, (void)end_face;
    return 1;
#endif
}

static void dgfemi_polyhedron_add_face(const dgfem_polyhedron *p, int face, dgfemi_moments *moments) {
    int l, count;
    for (l = p->face_loops[face]; l < p->face_loops[face + 1]; l++) {
        const int *loop = dgfemi_polyhedron_loop(p, l, &count);
        dgfemi_moments_loop(moments, p->vertices, loop, count, 0);
    }
}

static void dgfemi_polyhedron_moments(const dgfem_polyhedron *p, int degree, dgfem_vec3 centre, dgfem_real *out) {
    dgfemi_moments moments;
    int f;
    dgfemi_moments_begin_volume(&moments, degree, centre, dgfemi_polyhedron_reach(p, centre, 0, p->face_count));
    dgfemi_moments_unscaled(&moments);
    for (f = 0; f < p->face_count; f++) dgfemi_polyhedron_add_face(p, f, &moments);
    dgfemi_moments_end(&moments, out);
}

static void dgfemi_polyhedron_face_moments(const dgfem_polyhedron *p, int face, int degree, dgfem_vec3 centre,
                                           dgfem_real *out) {
    const dgfem_vec3 normal = dgfemi_normalized(dgfemi_polyhedron_vector_area(p, face));
    dgfemi_moments moments;
    dgfemi_moments_begin_face(&moments, degree, centre, dgfemi_polyhedron_reach(p, centre, face, face + 1), normal);
    dgfemi_moments_unscaled(&moments);
    dgfemi_polyhedron_add_face(p, face, &moments);
    dgfemi_moments_end(&moments, out);
}

static dgfem_status dgfemi_check_moments_call(const dgfem_polyhedron *p, int degree, dgfem_vec3 centre,
                                              const dgfem_real *out) {
    if (!p) return DGFEM_ERROR_ARGUMENT;
    if (!out) return dgfemi_fail(&p->hooks, DGFEM_ERROR_ARGUMENT, "moments: nowhere to put them");
    if (degree < 0 || degree > DGFEM_MAX_MOMENT_DEGREE)
        return dgfemi_fail(&p->hooks, DGFEM_ERROR_ARGUMENT, "moments of degree %d; 0..%d can be had", degree,
                           DGFEM_MAX_MOMENT_DEGREE);
    if (!dgfemi_is_finite3(centre)) return dgfemi_fail(&p->hooks, DGFEM_ERROR_NOT_FINITE, "centre of the moments");
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_face_index(const dgfem_polyhedron *p, int face) {
    if (face >= 0 && face < p->face_count) return DGFEM_OK;
    return dgfemi_fail(&p->hooks, DGFEM_ERROR_INDEX, "face %d of %d", face, p->face_count);
}

DGFEM_API dgfem_status dgfem_polyhedron_moments(const dgfem_polyhedron *polyhedron, int degree, dgfem_vec3 centre,
                                                dgfem_real *out) {
    const dgfem_status status = dgfemi_check_moments_call(polyhedron, degree, centre, out);
    if (status) return status;
    dgfemi_polyhedron_moments(polyhedron, degree, centre, out);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_polyhedron_face_moments(const dgfem_polyhedron *polyhedron, int face, int degree,
                                                     dgfem_vec3 centre, dgfem_real *out) {
    dgfem_status status = dgfemi_check_moments_call(polyhedron, degree, centre, out);
    if (!status) status = dgfemi_check_face_index(polyhedron, face);
    if (status) return status;
    dgfemi_polyhedron_face_moments(polyhedron, face, degree, centre, out);
    return DGFEM_OK;
}

DGFEM_API dgfem_measure dgfem_polyhedron_measure(const dgfem_polyhedron *polyhedron) {
    dgfem_measure measure;
    dgfem_real moments[4];
    dgfem_vec3 centre;
    int f;
    memset(&measure, 0, sizeof measure);
    if (!polyhedron) return measure;
    dgfemi_polyhedron_box(polyhedron, &measure.lower, &measure.upper);
    centre = dgfemi_add_scaled(measure.lower, DGFEM_R(0.5), dgfemi_sub(measure.upper, measure.lower));
    dgfemi_polyhedron_moments(polyhedron, 1, centre, moments);
    measure.volume = moments[0];
    measure.centroid = centre;
    if (measure.volume != 0)
        measure.centroid =
            dgfemi_add(centre, dgfemi_vec3(moments[1] / moments[0], moments[2] / moments[0], moments[3] / moments[0]));
    for (f = 0; f < polyhedron->face_count; f++)
        measure.area += dgfemi_norm(dgfemi_polyhedron_vector_area(polyhedron, f)) / 2;
    return measure;
}

/* ---- contains ---- */

/* How often the surface of one face, hit from inside minus from outside, lies straight above a point (direction +z).

   Whether the vertical line hits is decided exactly in the x-y projection, edge by edge, so that faces that share an
   edge agree: hits are neither doubled nor lost, wherever the point is. What remains is whether the hit lies above;
   outside of the face's own range of z that is plain, and inside it an error can only occur next to the surface. */
static int dgfemi_polyhedron_hits_above(const dgfem_polyhedron *p, int face, dgfem_vec3 point) {
    const int first = dgfemi_polyhedron_first_corner(p, face), end = dgfemi_polyhedron_first_corner(p, face + 1);
    const double q[2] = {(double)point.x, (double)point.y};
    dgfem_real lower = p->vertices[p->loop_vertices[first]].z, upper = lower;
    dgfem_vec3 normal;
    int winding = 0, l, i;
    for (i = first + 1; i < end; i++) {
        lower = dgfemi_min(lower, p->vertices[p->loop_vertices[i]].z);
        upper = dgfemi_max(upper, p->vertices[p->loop_vertices[i]].z);
    }
    if (upper < point.z) return 0;
    for (l = p->face_loops[face]; l < p->face_loops[face + 1]; l++) {
        int count;
        const int *loop = dgfemi_polyhedron_loop(p, l, &count);
        for (i = 0; i < count; i++) {
            const dgfem_vec3 va = p->vertices[loop[i]], vb = p->vertices[loop[i + 1 < count ? i + 1 : 0]];
            const double a[2] = {(double)va.x, (double)va.y}, b[2] = {(double)vb.x, (double)vb.y};
            winding += dgfemi_edge_winding(a, b, q);
        }
    }
    if (winding == 0 || lower > point.z) return winding;
    normal = dgfemi_polyhedron_vector_area(p, face);
    if (normal.z < 0) normal = dgfemi_scale(-1, normal);
    return dgfemi_dot(normal, dgfemi_sub(p->vertices[p->loop_vertices[first]], point)) > 0 ? winding : 0;
}

DGFEM_API int dgfem_polyhedron_contains(const dgfem_polyhedron *polyhedron, dgfem_vec3 point) {
    int winding = 0, f;
    if (!polyhedron || !dgfemi_is_finite3(point)) return 0;
    for (f = 0; f < polyhedron->face_count; f++) winding += dgfemi_polyhedron_hits_above(polyhedron, f, point);
    return winding > 0;
}

/* ---- edges ---- */

/* All directed edges, in buckets by their lower vertex: bucket v holds start[v] <= i < start[v + 1]. */
typedef struct dgfemi_edge_table {
    int *start;          /* [vertex_count + 1] */
    int *upper;          /* the other vertex */
    int *face;           /* ~face where the face runs along the edge from the upper to the lower vertex */
    int *balance, *last; /* [vertex_count] room for users, zero */
} dgfemi_edge_table;

static int dgfemi_edge_table_allocate(const dgfem_polyhedron *p, dgfemi_arena *arena, dgfemi_edge_table *table) {
    const size_t vertices = (size_t)p->vertex_count + 1;
    const size_t corners = (size_t)dgfemi_polyhedron_first_corner(p, p->face_count);
    table->start = (int *)dgfemi_arena_allocate_zero(arena, vertices, sizeof(int));
    table->upper = (int *)dgfemi_arena_allocate(arena, corners, sizeof(int));
    table->face = (int *)dgfemi_arena_allocate(arena, corners, sizeof(int));
    table->balance = (int *)dgfemi_arena_allocate_zero(arena, vertices, sizeof(int));
    table->last = (int *)dgfemi_arena_allocate_zero(arena, vertices, sizeof(int));
    return table->start && table->upper && table->face && table->balance && table->last;
}

/* Pass 0 counts the edges of each bucket, pass 1 fills the buckets from their ends. */
static void dgfemi_edge_table_pass(const dgfem_polyhedron *p, dgfemi_edge_table *table, int pass) {
    int f, l, i, count;
    for (f = 0; f < p->face_count; f++)
        for (l = p->face_loops[f]; l < p->face_loops[f + 1]; l++) {
            const int *loop = dgfemi_polyhedron_loop(p, l, &count);
            for (i = 0; i < count; i++) {
                const int a = loop[i], b = loop[i + 1 < count ? i + 1 : 0], lower = a < b ? a : b;
                if (pass == 0) {
                    table->start[lower]++;
                } else {
                    const int slot = --table->start[lower];
                    table->upper[slot] = a < b ? b : a;
                    table->face[slot] = a < b ? f : ~f;
                }
            }
        }
}

static int dgfemi_edge_table_make(const dgfem_polyhedron *p, dgfemi_arena *arena, dgfemi_edge_table *table) {
    int v;
    if (!dgfemi_edge_table_allocate(p, arena, table)) return 0;
    dgfemi_edge_table_pass(p, table, 0);
    for (v = 1; v <= p->vertex_count; v++) table->start[v] += table->start[v - 1];
    dgfemi_edge_table_pass(p, table, 1);
    return 1;
}

/* ---- check ---- */

static dgfem_status dgfemi_check_closed(const dgfem_polyhedron *p, dgfemi_arena *arena) {
    dgfemi_edge_table table;
    int v, i;
    if (!dgfemi_edge_table_make(p, arena, &table)) return dgfemi_fail_memory(&p->hooks);
    for (v = 0; v < p->vertex_count; v++) {
        for (i = table.start[v]; i < table.start[v + 1]; i++)
            table.balance[table.upper[i]] += table.face[i] >= 0 ? 1 : -1;
        for (i = table.start[v]; i < table.start[v + 1]; i++) {
            const int upper = table.upper[i], surplus = table.balance[upper], face = table.face[i];
            if (surplus != 0 && (surplus > 0) == (face >= 0))
                return dgfemi_fail(&p->hooks, DGFEM_ERROR_OPEN,
                                   "edge from vertex %d to vertex %d of face %d lacks its opposite",
                                   surplus > 0 ? v : upper, surplus > 0 ? upper : v, face >= 0 ? face : ~face);
        }
        for (i = table.start[v]; i < table.start[v + 1]; i++) table.balance[table.upper[i]] = 0;
    }
    return DGFEM_OK;
}

/* Largest distance of a face's vertices from the plane through their mean. */
static dgfem_real dgfemi_polyhedron_unevenness(const dgfem_polyhedron *p, int face, dgfem_vec3 unit_normal) {
    const int first = dgfemi_polyhedron_first_corner(p, face), end = dgfemi_polyhedron_first_corner(p, face + 1);
    const dgfem_vec3 origin = p->vertices[p->loop_vertices[first]];
    dgfem_real sum = 0, lower = 0, upper = 0, mean;
    int i;
    for (i = first; i < end; i++) {
        const dgfem_real distance = dgfemi_dot(unit_normal, dgfemi_sub(p->vertices[p->loop_vertices[i]], origin));
        sum += distance, lower = dgfemi_min(lower, distance), upper = dgfemi_max(upper, distance);
    }
    mean = sum / (dgfem_real)(end - first);
    return dgfemi_max(upper - mean, mean - lower);
}

static int dgfemi_polyhedron_planar(const dgfem_polyhedron *p, int face, dgfem_vec3 normal, dgfemi_arena *arena,
                                    dgfemi_planar *planar) {
    const int first = p->face_loops[face], count = p->face_loops[face + 1] - first;
    return dgfemi_planar_make(planar, arena, p->vertices, p->loop_vertices, p->loop_start + first, count, normal);
}

static dgfem_status dgfemi_check_simple(const dgfem_polyhedron *p, int face, dgfem_vec3 normal) {
    dgfemi_arena arena = dgfemi_arena_make(&p->hooks);
    dgfemi_planar planar;
    dgfem_status status = DGFEM_OK;
    int e, f;
    if (!dgfemi_polyhedron_planar(p, face, normal, &arena, &planar)) {
        status = dgfemi_fail_memory(&p->hooks);
    } else if (dgfemi_planar_find_clash(&planar, &e, &f)) {
        status = dgfemi_fail(&p->hooks, DGFEM_ERROR_NOT_SIMPLE, "face %d: edge %d-%d meets edge %d-%d", face,
                             planar.vertex[e], planar.vertex[planar.next[e]], planar.vertex[f],
                             planar.vertex[planar.next[f]]);
    } else {
        e = dgfemi_planar_find_misplaced(&planar);
        if (e != DGFEM_NONE)
            status = dgfemi_fail(&p->hooks, DGFEM_ERROR_NOT_SIMPLE,
                                 "face %d: its loop %d is neither a hole nor outside", face, e);
    }
    dgfemi_arena_free(&arena);
    return status;
}

static dgfem_status dgfemi_check_face(const dgfem_polyhedron *p, int face, dgfem_real tolerance, dgfem_real size) {
    const dgfem_vec3 area = dgfemi_polyhedron_vector_area(p, face);
    const dgfem_vec3 normal = dgfemi_normalized(area);
    dgfem_real distance;
    if (!(dgfemi_dot(normal, normal) > 0))
        return dgfemi_fail(&p->hooks, DGFEM_ERROR_DEGENERATE, "face %d has no area", face);
    distance = dgfemi_polyhedron_unevenness(p, face, normal);
    if (!(distance <= tolerance * size))
        return dgfemi_fail(&p->hooks, DGFEM_ERROR_NOT_PLANAR, "face %d: a vertex lies %g off its plane", face,
                           (double)distance);
    return dgfemi_check_simple(p, face, area);
}

/* Thinner than the round-off of its coordinates counts as no volume at all. */
static dgfem_status dgfemi_check_volume(const dgfem_polyhedron *p, dgfem_real size) {
    const dgfem_measure measure = dgfem_polyhedron_measure(p);
    const dgfem_real noise = DGFEM_EPSILON * size * measure.area;
    if (measure.volume < -noise)
        return dgfemi_fail(&p->hooks, DGFEM_ERROR_INSIDE_OUT, "polyhedron has the volume %g", (double)measure.volume);
    if (!(measure.volume > noise))
        return dgfemi_fail(&p->hooks, DGFEM_ERROR_DEGENERATE, "polyhedron has the volume %g", (double)measure.volume);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_polyhedron_check(const dgfem_polyhedron *polyhedron, dgfem_real tolerance) {
    dgfemi_arena arena;
    dgfem_vec3 lower, upper;
    dgfem_status status;
    int f;
    if (!polyhedron) return DGFEM_ERROR_ARGUMENT;
    if (!(tolerance >= 0) || !dgfemi_is_finite(tolerance))
        return dgfemi_fail(&polyhedron->hooks, DGFEM_ERROR_ARGUMENT, "tolerance %g", (double)tolerance);
    arena = dgfemi_arena_make(&polyhedron->hooks);
    status = dgfemi_check_closed(polyhedron, &arena);
    dgfemi_arena_free(&arena);
    dgfemi_polyhedron_box(polyhedron, &lower, &upper);
    for (f = 0; !status && f < polyhedron->face_count; f++)
        status = dgfemi_check_face(polyhedron, f, tolerance, dgfemi_distance(lower, upper));
    return status ? status : dgfemi_check_volume(polyhedron, dgfemi_distance(lower, upper));
}

/* ---- triangles ---- */

DGFEM_API dgfem_status dgfem_polyhedron_triangulate_face(const dgfem_polyhedron *polyhedron, int face, int *triangles,
                                                         int capacity, int *count) {
    dgfemi_arena arena;
    dgfemi_planar planar;
    dgfemi_triangles out;
    dgfem_status status;
    int *group;
    if (!polyhedron) return DGFEM_ERROR_ARGUMENT;
    status = dgfemi_check_face_index(polyhedron, face);
    if (status) return status;
    if (!count || capacity < 0 || (capacity > 0 && !triangles))
        return dgfemi_fail(&polyhedron->hooks, DGFEM_ERROR_ARGUMENT, "triangles: no room for %d of them or their count",
                           capacity);
    arena = dgfemi_arena_make(&polyhedron->hooks);
    group = (int *)dgfemi_arena_allocate(
        &arena, (size_t)(polyhedron->face_loops[face + 1] - polyhedron->face_loops[face]), sizeof(int));
    if (!group ||
        !dgfemi_polyhedron_planar(polyhedron, face, dgfemi_polyhedron_vector_area(polyhedron, face), &arena, &planar)) {
        dgfemi_arena_free(&arena);
        return dgfemi_fail_memory(&polyhedron->hooks);
    }
    out.data = triangles, out.capacity = capacity, out.count = 0;
    if (capacity > 0) dgfemi_planar_triangulate(&planar, group, &out);
    *count = dgfemi_planar_triangle_count(&planar);
    dgfemi_arena_free(&arena);
    return DGFEM_OK;
}

/* ---- components ---- */

typedef struct dgfemi_components {
    int *of_face;       /* [face_count] component of each face, numbered in the order of their first faces */
    int *host;          /* the component that a void belongs to; its own number for others */
    dgfem_real *volume; /* signed */
    int *seed;          /* a vertex of the first face */
    int *winding;       /* room */
    int count;
} dgfemi_components;

static int dgfemi_root(int *parent, int i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

/* Joins faces that share an edge; the smaller number becomes the root. */
static void dgfemi_join_faces(const dgfem_polyhedron *p, const dgfemi_edge_table *table, int *parent) {
    int v, i;
    for (v = 0; v < p->vertex_count; v++)
        for (i = table->start[v]; i < table->start[v + 1]; i++) {
            const int upper = table->upper[i], face = table->face[i] >= 0 ? table->face[i] : ~table->face[i];
            if (table->last[upper] == v + 1) {
                const int a = dgfemi_root(parent, face), b = dgfemi_root(parent, table->balance[upper]);
                parent[a < b ? b : a] = a < b ? a : b;
            }
            table->last[upper] = v + 1;
            table->balance[upper] = face;
        }
}

/* Numbers the components and sums their volumes, each about a vertex of its own. */
static void dgfemi_components_measure(const dgfem_polyhedron *p, const int *parent, dgfemi_components *c) {
    int f, l, i, count;
    for (f = 0; f < p->face_count; f++) {
        if (parent[f] == f) {
            c->volume[c->count] = 0;
            c->seed[c->count] = p->loop_vertices[dgfemi_polyhedron_first_corner(p, f)];
            c->host[c->count] = c->count;
            c->of_face[f] = c->count++;
        } else {
            c->of_face[f] = c->of_face[parent[f]]; /* parents come first */
        }
        for (l = p->face_loops[f]; l < p->face_loops[f + 1]; l++) {
            const int *loop = dgfemi_polyhedron_loop(p, l, &count);
            const dgfem_vec3 o = p->vertices[c->seed[c->of_face[f]]], a = dgfemi_sub(p->vertices[loop[0]], o);
            for (i = 2; i < count; i++)
                c->volume[c->of_face[f]] += dgfemi_triple_product(a, dgfemi_sub(p->vertices[loop[i - 1]], o),
                                                                  dgfemi_sub(p->vertices[loop[i]], o)) /
                                            6;
        }
    }
}

/* A void goes to the smallest component that contains the middle of its first edge. */
static void dgfemi_components_attach_void(const dgfem_polyhedron *p, dgfemi_components *c, int hollow) {
    dgfem_vec3 point;
    int f = 0, k;
    while (c->of_face[f] != hollow) f++;
    k = dgfemi_polyhedron_first_corner(p, f);
    point =
        dgfemi_scale(DGFEM_R(0.5), dgfemi_add(p->vertices[p->loop_vertices[k]], p->vertices[p->loop_vertices[k + 1]]));
    memset(c->winding, 0, (size_t)c->count * sizeof(int));
    for (f = 0; f < p->face_count; f++) c->winding[c->of_face[f]] += dgfemi_polyhedron_hits_above(p, f, point);
    for (k = 0; k < c->count; k++) {
        const int host = c->host[hollow];
        if (c->volume[k] > 0 && c->winding[k] > 0 && (host == hollow || c->volume[k] < c->volume[host]))
            c->host[hollow] = k;
    }
}

/* Replaces the components of faces by their hosts and closes the gaps in the numbers. */
static void dgfemi_components_renumber(const dgfem_polyhedron *p, dgfemi_components *c) {
    int f, k, next = 0;
    for (f = 0; f < p->face_count; f++) c->of_face[f] = c->host[c->of_face[f]];
    for (k = 0; k < c->count; k++) c->seed[k] = DGFEM_NONE;
    for (f = 0; f < p->face_count; f++) {
        if (c->seed[c->of_face[f]] == DGFEM_NONE) c->seed[c->of_face[f]] = next++;
        c->of_face[f] = c->seed[c->of_face[f]];
    }
    c->count = next;
}

/* 0 when out of memory. */
static int dgfemi_components_find(const dgfem_polyhedron *p, dgfemi_arena *arena, dgfemi_components *c) {
    const size_t faces = (size_t)p->face_count;
    int *parent = (int *)dgfemi_arena_allocate(arena, faces, sizeof(int));
    dgfemi_edge_table table;
    int f, k;
    c->of_face = (int *)dgfemi_arena_allocate(arena, faces, sizeof(int));
    c->host = (int *)dgfemi_arena_allocate(arena, faces, sizeof(int));
    c->seed = (int *)dgfemi_arena_allocate(arena, faces, sizeof(int));
    c->winding = (int *)dgfemi_arena_allocate(arena, faces, sizeof(int));
    c->volume = (dgfem_real *)dgfemi_arena_allocate(arena, faces, sizeof(dgfem_real));
    c->count = 0;
    if (!parent || !c->of_face || !c->host || !c->seed || !c->winding || !c->volume) return 0;
    if (!dgfemi_edge_table_make(p, arena, &table)) return 0;
    for (f = 0; f < p->face_count; f++) parent[f] = f;
    dgfemi_join_faces(p, &table, parent);
    dgfemi_components_measure(p, parent, c);
    for (k = 0; k < c->count; k++)
        if (c->volume[k] < 0) dgfemi_components_attach_void(p, c, k);
    dgfemi_components_renumber(p, c);
    return 1;
}

/* The faces of component k with the vertices that they use; NULL when out of memory. */
static dgfem_polyhedron *dgfemi_polyhedron_extract(const dgfem_polyhedron *p, const int *component, int k,
                                                   int *new_vertex) {
    dgfem_polyhedron *part;
    int faces = 0, loops = 0, corners = 0, vertices = 0, f, l, i;
    for (i = 0; i < p->vertex_count; i++) new_vertex[i] = DGFEM_NONE;
    for (f = 0; f < p->face_count; f++) {
        if (component[f] != k) continue;
        faces++, loops += p->face_loops[f + 1] - p->face_loops[f];
        for (i = dgfemi_polyhedron_first_corner(p, f); i < dgfemi_polyhedron_first_corner(p, f + 1); i++, corners++)
            new_vertex[p->loop_vertices[i]] = 0;
    }
    for (i = 0; i < p->vertex_count; i++)
        if (new_vertex[i] != DGFEM_NONE) new_vertex[i] = vertices++;
    part = dgfemi_polyhedron_allocate(&p->hooks, vertices, faces, loops, corners);
    if (!part) return NULL;
    for (i = 0; i < p->vertex_count; i++)
        if (new_vertex[i] != DGFEM_NONE) part->vertices[new_vertex[i]] = p->vertices[i];
    faces = loops = corners = 0;
    for (f = 0; f < p->face_count; f++) {
        if (component[f] != k) continue;
        part->face_loops[faces++] = loops;
        for (l = p->face_loops[f]; l < p->face_loops[f + 1]; l++) {
            part->loop_start[loops++] = corners;
            for (i = p->loop_start[l]; i < p->loop_start[l + 1]; i++)
                part->loop_vertices[corners++] = new_vertex[p->loop_vertices[i]];
        }
    }
    part->face_loops[faces] = loops;
    part->loop_start[loops] = corners;
    return part;
}

DGFEM_API dgfem_status dgfem_polyhedron_component_count(const dgfem_polyhedron *polyhedron, int *count) {
    dgfemi_arena arena;
    dgfemi_components components;
    int ok;
    if (!polyhedron) return DGFEM_ERROR_ARGUMENT;
    if (!count) return dgfemi_fail(&polyhedron->hooks, DGFEM_ERROR_ARGUMENT, "components: nowhere to put their number");
    arena = dgfemi_arena_make(&polyhedron->hooks);
    ok = dgfemi_components_find(polyhedron, &arena, &components);
    if (ok) *count = components.count;
    dgfemi_arena_free(&arena);
    return ok ? DGFEM_OK : dgfemi_fail_memory(&polyhedron->hooks);
}

DGFEM_API dgfem_status dgfem_polyhedron_component(const dgfem_polyhedron *polyhedron, int k, dgfem_polyhedron **out) {
    dgfemi_arena arena;
    dgfemi_components components;
    dgfem_status status = DGFEM_OK;
    int *new_vertex;
    if (out) *out = NULL;
    if (!polyhedron) return DGFEM_ERROR_ARGUMENT;
    if (!out) return dgfemi_fail(&polyhedron->hooks, DGFEM_ERROR_ARGUMENT, "component: nowhere to put it");
    arena = dgfemi_arena_make(&polyhedron->hooks);
    new_vertex = (int *)dgfemi_arena_allocate(&arena, (size_t)polyhedron->vertex_count, sizeof(int));
    if (!new_vertex || !dgfemi_components_find(polyhedron, &arena, &components)) {
        status = dgfemi_fail_memory(&polyhedron->hooks);
    } else if (k < 0 || k >= components.count) {
        status = dgfemi_fail(&polyhedron->hooks, DGFEM_ERROR_INDEX, "component %d of %d", k, components.count);
    } else {
        *out = dgfemi_polyhedron_extract(polyhedron, components.of_face, k, new_vertex);
        if (!*out) status = dgfemi_fail_memory(&polyhedron->hooks);
    }
    dgfemi_arena_free(&arena);
    return status;
}

/* ==== mesh.c ====================================================================================================== */

/* The cell complex: storage, measures, compacting, copies, queries, edges.

   Faces own a range of `loops`, loops a range of `loop_vertices`, elements a range of `element_faces`. An edit appends
   the new ranges behind the old ones and marks what it replaces as dead (face: element[0] == DGFEM_NONE, element:
   face_count == 0); dgfemi_mesh_compact removes all that is dead or no longer referenced. Appending may move the
   arrays: hold indices, not pointers, across it. */

static dgfem_mesh *dgfemi_mesh_new(const dgfem_hooks *hooks) {
    dgfem_mesh *mesh = (dgfem_mesh *)dgfemi_allocate_zero(hooks, 1, sizeof *mesh);
    if (mesh) mesh->hooks = *hooks;
    return mesh;
}

DGFEM_API void dgfem_mesh_destroy(dgfem_mesh *mesh) {
    dgfem_hooks hooks;
    if (!mesh) return;
    hooks = mesh->hooks;
    dgfemi_free(&hooks, mesh->vertices);
    dgfemi_free(&hooks, mesh->faces);
    dgfemi_free(&hooks, mesh->elements);
    dgfemi_free(&hooks, mesh->loops);
    dgfemi_free(&hooks, mesh->loop_vertices);
    dgfemi_free(&hooks, mesh->element_faces);
    dgfemi_free(&hooks, mesh);
}

/* ---- appending: the new index, or DGFEM_NONE when out of memory or out of indices ---- */

/* Makes *data hold `extra` more items. 1 on success; on failure 0, and nothing has changed. */
static int dgfemi_mesh_room(const dgfem_hooks *hooks, void **data, int count, int *capacity, int extra, size_t size) {
    void *grown;
    DGFEM_ASSERT(extra >= 0);
    if (extra > INT_MAX - count) return 0;
    if (count + extra <= *capacity) return 1;
    grown = dgfemi_grow(hooks, *data, capacity, count + extra, size);
    if (!grown) return 0;
    *data = grown;
    return 1;
}

/* Room for so many more items of each kind, so that appending them cannot fail. 1 on success. */
static int dgfemi_mesh_reserve(dgfem_mesh *mesh, int vertices, int faces, int elements, int loops, int loop_vertices,
                               int element_faces) {
    const dgfem_hooks *hooks = &mesh->hooks;
    void *data[6];
    int ok;
    data[0] = mesh->vertices, data[1] = mesh->faces, data[2] = mesh->elements;
    data[3] = mesh->loops, data[4] = mesh->loop_vertices, data[5] = mesh->element_faces;
    ok = dgfemi_mesh_room(hooks, &data[0], mesh->vertex_count, &mesh->vertex_capacity, vertices, sizeof(dgfem_vec3)) &&
         dgfemi_mesh_room(hooks, &data[1], mesh->face_count, &mesh->face_capacity, faces, sizeof(dgfem_face)) &&
         dgfemi_mesh_room(hooks, &data[2], mesh->element_count, &mesh->element_capacity, elements,
                          sizeof(dgfem_element)) &&
         dgfemi_mesh_room(hooks, &data[3], mesh->loop_count, &mesh->loop_capacity, loops, sizeof(dgfem_loop)) &&
         dgfemi_mesh_room(hooks, &data[4], mesh->loop_vertex_count, &mesh->loop_vertex_capacity, loop_vertices,
                          sizeof(int)) &&
         dgfemi_mesh_room(hooks, &data[5], mesh->element_face_count, &mesh->element_face_capacity, element_faces,
                          sizeof(int));
    mesh->vertices = (dgfem_vec3 *)data[0], mesh->faces = (dgfem_face *)data[1];
    mesh->elements = (dgfem_element *)data[2], mesh->loops = (dgfem_loop *)data[3];
    mesh->loop_vertices = (int *)data[4], mesh->element_faces = (int *)data[5];
    return ok;
}

/* Appends to one of the two index pools. The source may lie in the pool itself, which may move. */
static int dgfemi_mesh_append(const dgfem_hooks *hooks, int **pool, int *pool_count, int *capacity, const int *source,
                              int count) {
    uintptr_t first = (uintptr_t)*pool, address = (uintptr_t)source;
    int inside = *pool && address >= first && address < (uintptr_t)(*pool + *pool_count);
    size_t offset = inside ? (size_t)(address - first) / sizeof(int) : 0;
    void *data = *pool;
    if (!dgfemi_mesh_room(hooks, &data, *pool_count, capacity, count, sizeof(int))) return DGFEM_NONE;
    *pool = (int *)data;
    if (inside) source = *pool + offset;
    if (count > 0) memcpy(*pool + *pool_count, source, (size_t)count * sizeof(int));
    *pool_count += count;
    return *pool_count - count;
}

static int dgfemi_mesh_add_vertex(dgfem_mesh *mesh, dgfem_vec3 p) {
    if (mesh->vertex_count == mesh->vertex_capacity && !dgfemi_mesh_reserve(mesh, 1, 0, 0, 0, 0, 0)) return DGFEM_NONE;
    mesh->vertices[mesh->vertex_count] = p;
    return mesh->vertex_count++;
}

/* `vertices` may point into mesh->loop_vertices. */
static int dgfemi_mesh_add_loop(dgfem_mesh *mesh, const int *vertices, int count) {
    dgfem_loop loop;
    if (mesh->loop_count == mesh->loop_capacity && !dgfemi_mesh_reserve(mesh, 0, 0, 0, 1, 0, 0)) return DGFEM_NONE;
    loop.count = count;
    loop.start = dgfemi_mesh_append(&mesh->hooks, &mesh->loop_vertices, &mesh->loop_vertex_count,
                                    &mesh->loop_vertex_capacity, vertices, count);
    if (loop.start == DGFEM_NONE) return DGFEM_NONE;
    mesh->loops[mesh->loop_count] = loop;
    return mesh->loop_count++;
}

/* Glued, and not measured yet. */
static int dgfemi_mesh_add_face(dgfem_mesh *mesh, int loop_start, int loop_count, int element0, int element1, int tag,
                                dgfem_vec3 normal) {
    dgfem_face *face;
    if (mesh->face_count == mesh->face_capacity && !dgfemi_mesh_reserve(mesh, 0, 1, 0, 0, 0, 0)) return DGFEM_NONE;
    face = &mesh->faces[mesh->face_count];
    memset(face, 0, sizeof *face);
    face->element[0] = element0, face->element[1] = element1;
    face->loop_start = loop_start, face->loop_count = loop_count;
    face->tag = tag;
    face->normal = normal;
    return mesh->face_count++;
}

/* Not measured yet; the faces' element[] is the caller's to set. `faces` may point into mesh->element_faces. */
static int dgfemi_mesh_add_element(dgfem_mesh *mesh, const int *faces, int count, int tag) {
    dgfem_element *element;
    int start;
    if (!dgfemi_mesh_reserve(mesh, 0, 0, 1, 0, 0, 0)) return DGFEM_NONE;
    start = dgfemi_mesh_append(&mesh->hooks, &mesh->element_faces, &mesh->element_face_count,
                               &mesh->element_face_capacity, faces, count);
    if (start == DGFEM_NONE) return DGFEM_NONE;
    element = &mesh->elements[mesh->element_count];
    memset(element, 0, sizeof *element);
    element->face_start = start, element->face_count = count;
    element->tag = tag;
    return mesh->element_count++;
}

/* ---- measures, always relative to a point nearby: a mesh may stand far from the origin ---- */

/* +1 where the face's normal points out of the element, else -1. */
static int dgfemi_mesh_sign(const dgfem_mesh *mesh, int element, int face) {
    DGFEM_ASSERT(mesh->faces[face].element[0] == element || mesh->faces[face].element[1] == element);
    return mesh->faces[face].element[0] == element ? 1 : -1;
}

/* Area times unit normal, from the loops alone. */
static dgfem_vec3 dgfemi_mesh_vector_area(const dgfem_mesh *mesh, int face) {
    const dgfem_face *f = &mesh->faces[face];
    dgfem_vec3 twice = dgfemi_vec3(0, 0, 0);
    int l, i;
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        dgfem_vec3 a = mesh->vertices[loop[0]], b = dgfemi_sub(mesh->vertices[loop[1]], a);
        for (i = 2; i < mesh->loops[l].count; i++) {
            dgfem_vec3 c = dgfemi_sub(mesh->vertices[loop[i]], a);
            twice = dgfemi_add(twice, dgfemi_cross(b, c));
            b = c;
        }
    }
    return dgfemi_scale(DGFEM_R(0.5), twice);
}

/* Zero where the loops enclose no area. */
static dgfem_vec3 dgfemi_mesh_unit_normal(const dgfem_mesh *mesh, int face) {
    return dgfemi_normalized(dgfemi_mesh_vector_area(mesh, face));
}

static void dgfemi_mesh_face_box(const dgfem_mesh *mesh, int face, dgfem_vec3 *lower, dgfem_vec3 *upper) {
    const dgfem_face *f = &mesh->faces[face];
    int l, i;
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++)
        for (i = 0; i < mesh->loops[l].count; i++) {
            dgfem_vec3 p = mesh->vertices[mesh->loop_vertices[mesh->loops[l].start + i]];
            *lower = dgfemi_min3(*lower, p);
            *upper = dgfemi_max3(*upper, p);
        }
}

static dgfem_vec3 dgfemi_mesh_first_vertex(const dgfem_mesh *mesh, int face) {
    return mesh->vertices[mesh->loop_vertices[mesh->loops[mesh->faces[face].loop_start].start]];
}

/* origin + moment / measure, kept inside the box: the quotient of a sliver is mostly round-off. */
static dgfem_vec3 dgfemi_mesh_centroid(dgfem_vec3 origin, dgfem_vec3 moment, dgfem_real measure, dgfem_vec3 lower,
                                       dgfem_vec3 upper) {
    dgfem_vec3 middle = dgfemi_add_scaled(lower, DGFEM_R(0.5), dgfemi_sub(upper, lower)), centre;
    if (!(measure > 0)) return middle;
    centre = dgfemi_vec3(origin.x + moment.x / measure, origin.y + moment.y / measure, origin.z + moment.z / measure);
    if (!dgfemi_is_finite3(centre)) return middle;
    return dgfemi_min3(dgfemi_max3(centre, lower), upper);
}

/* Centre and area of a face. The stored normal is used, and the area is that of the projection along it: it may be
   inherited and better than what the vertices of a sliver give. */
static void dgfemi_mesh_face_measures(const dgfem_mesh *mesh, int face, dgfem_vec3 *centre, dgfem_real *area) {
    const dgfem_face *f = &mesh->faces[face];
    dgfem_vec3 origin = dgfemi_mesh_first_vertex(mesh, face), lower = origin, upper = origin;
    dgfem_vec3 moment = dgfemi_vec3(0, 0, 0); /* 6 * first moment about the origin */
    dgfem_real twice = 0;                     /* 2 * area */
    int l, i;
    dgfemi_mesh_face_box(mesh, face, &lower, &upper);
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        dgfem_vec3 a = dgfemi_sub(mesh->vertices[loop[0]], origin), b = dgfemi_sub(mesh->vertices[loop[1]], origin);
        for (i = 2; i < mesh->loops[l].count; i++) {
            dgfem_vec3 c = dgfemi_sub(mesh->vertices[loop[i]], origin);
            dgfem_real s = dgfemi_dot(f->normal, dgfemi_cross(dgfemi_sub(b, a), dgfemi_sub(c, a)));
            twice += s;
            moment = dgfemi_add_scaled(moment, s, dgfemi_add(a, dgfemi_add(b, c)));
            b = c;
        }
    }
    *centre = dgfemi_mesh_centroid(origin, moment, 3 * twice, lower, upper);
    *area = dgfemi_max(DGFEM_R(0.5) * twice, 0);
}

static void dgfemi_mesh_measure_face(dgfem_mesh *mesh, int face) {
    dgfem_face *f = &mesh->faces[face];
    dgfemi_mesh_face_measures(mesh, face, &f->centre, &f->area);
}

/* Adds the tetrahedra between the origin and the fan of each loop of a face:
   volume += 6 V, moment += 24 * first moment about the origin. */
static void dgfemi_mesh_add_fan(const dgfem_mesh *mesh, int face, dgfem_real sign, dgfem_vec3 origin,
                                dgfem_real *volume, dgfem_vec3 *moment) {
    const dgfem_face *f = &mesh->faces[face];
    int l, i;
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        dgfem_vec3 a = dgfemi_sub(mesh->vertices[loop[0]], origin), b = dgfemi_sub(mesh->vertices[loop[1]], origin);
        for (i = 2; i < mesh->loops[l].count; i++) {
            dgfem_vec3 c = dgfemi_sub(mesh->vertices[loop[i]], origin);
            dgfem_real s = sign * dgfemi_dot(a, dgfemi_cross(b, c));
            *volume += s;
            *moment = dgfemi_add_scaled(*moment, s, dgfemi_add(a, dgfemi_add(b, c)));
            b = c;
        }
    }
}

/* Largest distance of a vertex of the element from a point. */
static dgfem_real dgfemi_mesh_element_reach(const dgfem_mesh *mesh, int element, dgfem_vec3 point) {
    const dgfem_element *e = &mesh->elements[element];
    dgfem_real square = 0;
    int k, l, i;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *f = &mesh->faces[mesh->element_faces[k]];
        for (l = f->loop_start; l < f->loop_start + f->loop_count; l++)
            for (i = 0; i < mesh->loops[l].count; i++) {
                int v = mesh->loop_vertices[mesh->loops[l].start + i];
                dgfem_vec3 d = dgfemi_sub(mesh->vertices[v], point);
                square = dgfemi_max(square, dgfemi_dot(d, d));
            }
    }
    return dgfemi_sqrt(square);
}

static void dgfemi_mesh_element_box(const dgfem_mesh *mesh, int element, dgfem_vec3 *lower, dgfem_vec3 *upper) {
    const dgfem_element *e = &mesh->elements[element];
    int k;
    *lower = *upper = dgfemi_mesh_first_vertex(mesh, mesh->element_faces[e->face_start]);
    for (k = e->face_start; k < e->face_start + e->face_count; k++)
        dgfemi_mesh_face_box(mesh, mesh->element_faces[k], lower, upper);
}

/* Centre and signed volume of an element with this bounding box. Neighbours fan their common face alike, so volumes of
   elements add up to that of the whole even where a face is not quite planar. */
static void dgfemi_mesh_element_measures(const dgfem_mesh *mesh, int element, dgfem_vec3 lower, dgfem_vec3 upper,
                                         dgfem_vec3 *centre, dgfem_real *volume) {
    const dgfem_element *e = &mesh->elements[element];
    dgfem_vec3 origin = dgfemi_add_scaled(lower, DGFEM_R(0.5), dgfemi_sub(upper, lower)), moment = dgfemi_vec3(0, 0, 0);
    dgfem_real six = 0; /* 6 * volume */
    int k;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        int face = mesh->element_faces[k];
        dgfemi_mesh_add_fan(mesh, face, (dgfem_real)dgfemi_mesh_sign(mesh, element, face), origin, &six, &moment);
    }
    *volume = six / 6;
    *centre = dgfemi_mesh_centroid(origin, moment, 4 * six, lower, upper);
}

static void dgfemi_mesh_measure_element(dgfem_mesh *mesh, int element) {
    dgfem_element *e = &mesh->elements[element];
    dgfem_vec3 lower, upper;
    dgfemi_mesh_element_box(mesh, element, &lower, &upper);
    dgfemi_mesh_element_measures(mesh, element, lower, upper, &e->centre, &e->volume);
    e->radius = dgfemi_mesh_element_reach(mesh, element, e->centre);
}

/* ---- compacting ---- */

/* The new pools and the new index of every old item. */
typedef struct dgfemi_mesh_packing {
    dgfem_loop *loops;
    int *loop_vertices, *element_faces;
    int loop_count, loop_vertex_count, element_face_count;
    int *vertex_map, *face_map, *element_map; /* old -> new, DGFEM_NONE for what goes */
} dgfemi_mesh_packing;

static int dgfemi_mesh_packing_allocate(const dgfem_mesh *mesh, dgfemi_mesh_packing *packing) {
    const dgfem_hooks *hooks = &mesh->hooks;
    size_t loops = 0, loop_vertices = 0, element_faces = 0;
    int e, f, l;
    for (f = 0; f < mesh->face_count; f++) {
        const dgfem_face *face = &mesh->faces[f];
        if (face->element[0] == DGFEM_NONE) continue;
        loops += (size_t)face->loop_count;
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            loop_vertices += (size_t)mesh->loops[l].count;
    }
    for (e = 0; e < mesh->element_count; e++) element_faces += (size_t)mesh->elements[e].face_count;
    memset(packing, 0, sizeof *packing);
    packing->loops = (dgfem_loop *)dgfemi_allocate(hooks, loops, sizeof(dgfem_loop));
    packing->loop_vertices = (int *)dgfemi_allocate(hooks, loop_vertices, sizeof(int));
    packing->element_faces = (int *)dgfemi_allocate(hooks, element_faces, sizeof(int));
    packing->vertex_map = (int *)dgfemi_allocate(hooks, (size_t)mesh->vertex_count, sizeof(int));
    packing->face_map = (int *)dgfemi_allocate(hooks, (size_t)mesh->face_count, sizeof(int));
    packing->element_map = (int *)dgfemi_allocate(hooks, (size_t)mesh->element_count, sizeof(int));
    return packing->loops && packing->loop_vertices && packing->element_faces && packing->vertex_map &&
           packing->face_map && packing->element_map;
}

static void dgfemi_mesh_packing_free(const dgfem_hooks *hooks, dgfemi_mesh_packing *packing) {
    dgfemi_free(hooks, packing->loops);
    dgfemi_free(hooks, packing->loop_vertices);
    dgfemi_free(hooks, packing->element_faces);
    dgfemi_free(hooks, packing->vertex_map);
    dgfemi_free(hooks, packing->face_map);
    dgfemi_free(hooks, packing->element_map);
}

/* Numbers what stays. */
static void dgfemi_mesh_packing_map(const dgfem_mesh *mesh, dgfemi_mesh_packing *packing) {
    int e, f, l, i, v, next_vertex = 0, next_face = 0, next_element = 0;
    for (v = 0; v < mesh->vertex_count; v++) packing->vertex_map[v] = DGFEM_NONE;
    for (f = 0; f < mesh->face_count; f++) {
        const dgfem_face *face = &mesh->faces[f];
        packing->face_map[f] = face->element[0] == DGFEM_NONE ? DGFEM_NONE : next_face++;
        if (face->element[0] == DGFEM_NONE) continue;
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            for (i = 0; i < mesh->loops[l].count; i++)
                packing->vertex_map[mesh->loop_vertices[mesh->loops[l].start + i]] = 0;
    }
    for (v = 0; v < mesh->vertex_count; v++)
        if (packing->vertex_map[v] != DGFEM_NONE) packing->vertex_map[v] = next_vertex++;
    for (e = 0; e < mesh->element_count; e++)
        packing->element_map[e] = mesh->elements[e].face_count == 0 ? DGFEM_NONE : next_element++;
}

/* Moves the live faces down and copies their loops into the new pools, in the order of the faces. */
static void dgfemi_mesh_pack_faces(dgfem_mesh *mesh, dgfemi_mesh_packing *packing) {
    int f, l, i, kept = 0;
    for (f = 0; f < mesh->face_count; f++) {
        dgfem_face face = mesh->faces[f];
        int first = packing->loop_count;
        if (packing->face_map[f] == DGFEM_NONE) continue;
        for (l = face.loop_start; l < face.loop_start + face.loop_count; l++) {
            dgfem_loop *loop = &packing->loops[packing->loop_count++];
            loop->start = packing->loop_vertex_count;
            loop->count = mesh->loops[l].count;
            for (i = 0; i < loop->count; i++)
                packing->loop_vertices[packing->loop_vertex_count++] =
                    packing->vertex_map[mesh->loop_vertices[mesh->loops[l].start + i]];
        }
        for (i = 0; i < 2; i++) {
            if (face.element[i] == DGFEM_NONE) continue;
            face.element[i] = packing->element_map[face.element[i]];
            DGFEM_ASSERT(face.element[i] != DGFEM_NONE); /* a live face of a dead element */
        }
        face.loop_start = first;
        mesh->faces[kept++] = face;
    }
    mesh->face_count = kept;
}

static void dgfemi_mesh_pack_elements(dgfem_mesh *mesh, dgfemi_mesh_packing *packing) {
    int e, k, kept = 0;
    for (e = 0; e < mesh->element_count; e++) {
        dgfem_element element = mesh->elements[e];
        int first = packing->element_face_count;
        if (packing->element_map[e] == DGFEM_NONE) continue;
        for (k = element.face_start; k < element.face_start + element.face_count; k++) {
            int face = packing->face_map[mesh->element_faces[k]];
            DGFEM_ASSERT(face != DGFEM_NONE); /* a live element with a dead face */
            packing->element_faces[packing->element_face_count++] = face;
        }
        element.face_start = first;
        mesh->elements[kept++] = element;
    }
    mesh->element_count = kept;
}

static void dgfemi_mesh_pack_vertices(dgfem_mesh *mesh, const dgfemi_mesh_packing *packing) {
    int v, kept = 0;
    for (v = 0; v < mesh->vertex_count; v++)
        if (packing->vertex_map[v] != DGFEM_NONE) mesh->vertices[kept++] = mesh->vertices[v];
    mesh->vertex_count = kept;
}

/* The packing receives the old pools, to be freed with it. */
static void dgfemi_mesh_take_pools(dgfem_mesh *mesh, dgfemi_mesh_packing *packing) {
    dgfem_loop *loops = mesh->loops;
    int *loop_vertices = mesh->loop_vertices, *element_faces = mesh->element_faces;
    mesh->loops = packing->loops, packing->loops = loops;
    mesh->loop_vertices = packing->loop_vertices, packing->loop_vertices = loop_vertices;
    mesh->element_faces = packing->element_faces, packing->element_faces = element_faces;
    mesh->loop_count = mesh->loop_capacity = packing->loop_count;
    mesh->loop_vertex_count = mesh->loop_vertex_capacity = packing->loop_vertex_count;
    mesh->element_face_count = mesh->element_face_capacity = packing->element_face_count;
}

/* Drops dead faces and elements and all loops and vertices that nothing refers to; the rest keeps its order and its
   measures and gets new indices. Logs when out of memory, and then the mesh is unchanged. */
static dgfem_status dgfemi_mesh_compact(dgfem_mesh *mesh) {
    dgfemi_mesh_packing packing;
    if (!dgfemi_mesh_packing_allocate(mesh, &packing)) {
        dgfemi_mesh_packing_free(&mesh->hooks, &packing);
        return dgfemi_fail_memory(&mesh->hooks);
    }
    dgfemi_mesh_packing_map(mesh, &packing);
    dgfemi_mesh_pack_faces(mesh, &packing);
    dgfemi_mesh_pack_elements(mesh, &packing);
    dgfemi_mesh_pack_vertices(mesh, &packing);
    dgfemi_mesh_take_pools(mesh, &packing);
    dgfemi_mesh_packing_free(&mesh->hooks, &packing);
    return DGFEM_OK;
}

/* ---- copies ---- */

/* Gives both meshes each other's content; the hooks go along. */
static void dgfemi_mesh_swap(dgfem_mesh *a, dgfem_mesh *b) {
    dgfem_mesh c = *a;
    *a = *b;
    *b = c;
}

/* Does not log. */
static dgfem_mesh *dgfemi_mesh_duplicate(const dgfem_mesh *mesh) {
    dgfem_mesh *copy = dgfemi_mesh_new(&mesh->hooks);
    if (!copy) return NULL;
    if (!dgfemi_mesh_reserve(copy, mesh->vertex_count, mesh->face_count, mesh->element_count, mesh->loop_count,
                             mesh->loop_vertex_count, mesh->element_face_count)) {
        dgfem_mesh_destroy(copy);
        return NULL;
    }
#define DGFEM_COPY_ARRAY(array, count, type)                                                                           \
    if (mesh->count > 0) memcpy(copy->array, mesh->array, (size_t)mesh->count * sizeof(type));                         \
    copy->count = mesh->count
    DGFEM_COPY_ARRAY(vertices, vertex_count, dgfem_vec3);
    DGFEM_COPY_ARRAY(faces, face_count, dgfem_face);
    DGFEM_COPY_ARRAY(elements, element_count, dgfem_element);
    DGFEM_COPY_ARRAY(loops, loop_count, dgfem_loop);
    DGFEM_COPY_ARRAY(loop_vertices, loop_vertex_count, int);
    DGFEM_COPY_ARRAY(element_faces, element_face_count, int);
#undef DGFEM_COPY_ARRAY
    return copy;
}

DGFEM_API dgfem_status dgfem_mesh_copy(const dgfem_mesh *mesh, dgfem_mesh **out) {
    if (out) *out = NULL;
    if (!mesh) return DGFEM_ERROR_ARGUMENT;
    if (!out) return dgfemi_fail(&mesh->hooks, DGFEM_ERROR_ARGUMENT, "nowhere to put the copy of the mesh");
    *out = dgfemi_mesh_duplicate(mesh);
    return *out ? DGFEM_OK : dgfemi_fail_memory(&mesh->hooks);
}

/* ---- queries ---- */

DGFEM_API dgfem_real dgfem_mesh_volume(const dgfem_mesh *mesh) {
    double sum = 0;
    int e;
    for (e = 0; mesh && e < mesh->element_count; e++) sum += (double)mesh->elements[e].volume;
    return (dgfem_real)sum;
}

DGFEM_API dgfem_real dgfem_mesh_boundary_area(const dgfem_mesh *mesh) {
    double sum = 0;
    int f;
    for (f = 0; mesh && f < mesh->face_count; f++)
        if (mesh->faces[f].element[1] == DGFEM_NONE) sum += (double)mesh->faces[f].area;
    return (dgfem_real)sum;
}

/* Largest distance of a vertex of the face from a plane with unit normal. */
static dgfem_real dgfemi_mesh_face_off_plane(const dgfem_mesh *mesh, int face, dgfem_vec3 normal, dgfem_real offset) {
    const dgfem_face *f = &mesh->faces[face];
    dgfem_real largest = 0;
    int l, i;
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++)
        for (i = 0; i < mesh->loops[l].count; i++) {
            dgfem_vec3 p = mesh->vertices[mesh->loop_vertices[mesh->loops[l].start + i]];
            largest = dgfemi_max(largest, dgfemi_abs(dgfemi_dot(normal, p) - offset));
        }
    return largest;
}

DGFEM_API int dgfem_mesh_faces_on_plane(const dgfem_mesh *mesh, dgfem_plane plane, dgfem_real tolerance, int *faces,
                                        int capacity) {
    int f, count = 0;
    for (f = 0; mesh && f < mesh->face_count; f++) {
        if (mesh->faces[f].element[1] != DGFEM_NONE) continue;
        if (!(dgfemi_mesh_face_off_plane(mesh, f, plane.normal, plane.offset) <= tolerance)) continue;
        if (faces && count < capacity) faces[count] = f;
        count++;
    }
    return count;
}

/* ---- vertices of elements ---- */

/* The largest number of loop vertices, repeats included, that an element has: room for dgfemi_mesh_element_vertices. */
static int dgfemi_mesh_max_element_corners(const dgfem_mesh *mesh) {
    int e, k, l, largest = 0;
    for (e = 0; e < mesh->element_count; e++) {
        const dgfem_element *element = &mesh->elements[e];
        int sum = 0;
        for (k = element->face_start; k < element->face_start + element->face_count; k++) {
            const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
            for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) sum += mesh->loops[l].count;
        }
        if (sum > largest) largest = sum;
    }
    return largest;
}

/* Writes the distinct vertices of an element in the order of their first use; returns their number.
   mark[vertex_count] holds `element` nowhere before and at those vertices after the call, so that one array serves all
   elements in turn. */
static int dgfemi_mesh_element_vertices(const dgfem_mesh *mesh, int element, int *mark, int *vertices) {
    const dgfem_element *e = &mesh->elements[element];
    int k, l, i, count = 0;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            for (i = 0; i < mesh->loops[l].count; i++) {
                int v = mesh->loop_vertices[mesh->loops[l].start + i];
                if (mark[v] == element) continue;
                mark[v] = element;
                vertices[count++] = v;
            }
    }
    return count;
}

/* ---- hashing ---- */

static uint64_t dgfemi_mix(uint64_t x) {
    x = (x ^ (x >> 30)) * ((uint64_t)0xbf58476du << 32 | 0x1ce4e5b9u);
    x = (x ^ (x >> 27)) * ((uint64_t)0x94d049bbu << 32 | 0x133111ebu);
    return x ^ (x >> 31);
}

static uint64_t dgfemi_hash_pair(int a, int b) { return dgfemi_mix((uint64_t)(unsigned)a << 32 | (unsigned)b); }

/* Items 0, 1, 2, ... chained by hash. The caller compares:
   for (i = dgfemi_buckets_first(&b, hash); i != DGFEM_NONE; i = b.next[i]) ... */
typedef struct dgfemi_buckets {
    int *first; /* [mask + 1] */
    int *next;  /* [next_capacity] */
    uint64_t mask;
    int first_capacity, next_capacity;
} dgfemi_buckets;

/* Empties the table and fits it to about so many items. 1 on success, 0 when out of memory. */
static int dgfemi_buckets_reset(const dgfem_hooks *hooks, dgfemi_buckets *buckets, int items) {
    int size = 16, i;
    while (size < items && size < (1 << 30)) size *= 2;
    if (size > buckets->first_capacity) {
        int *grown = (int *)dgfemi_grow(hooks, buckets->first, &buckets->first_capacity, size, sizeof(int));
        if (!grown) return 0;
        buckets->first = grown;
    }
    buckets->mask = (uint64_t)size - 1;
    for (i = 0; i < size; i++) buckets->first[i] = DGFEM_NONE;
    return 1;
}

static int dgfemi_buckets_first(const dgfemi_buckets *buckets, uint64_t hash) {
    return buckets->first[hash & buckets->mask];
}

/* Items may come in any order, each once. 1 on success, 0 when out of memory. */
static int dgfemi_buckets_insert(const dgfem_hooks *hooks, dgfemi_buckets *buckets, int item, uint64_t hash) {
    if (item >= buckets->next_capacity) {
        int *grown = (int *)dgfemi_grow(hooks, buckets->next, &buckets->next_capacity, item + 1, sizeof(int));
        if (!grown) return 0;
        buckets->next = grown;
    }
    buckets->next[item] = buckets->first[hash & buckets->mask];
    buckets->first[hash & buckets->mask] = item;
    return 1;
}

static void dgfemi_buckets_free(const dgfem_hooks *hooks, dgfemi_buckets *buckets) {
    dgfemi_free(hooks, buckets->first);
    dgfemi_free(hooks, buckets->next);
}

/* ---- edges ---- */

/* An undirected edge a < b and how often faces run along it either way. */
typedef struct dgfemi_edge {
    int a, b;
    int forward, backward; /* uses a -> b and b -> a */
} dgfemi_edge;

/* Zeroed memory is a valid empty table. */
typedef struct dgfemi_edges {
    dgfemi_edge *data;
    int count, capacity;
    dgfemi_buckets buckets;
} dgfemi_edges;

static void dgfemi_edges_free(const dgfem_hooks *hooks, dgfemi_edges *edges) {
    dgfemi_free(hooks, edges->data);
    dgfemi_buckets_free(hooks, &edges->buckets);
}

/* Empties the table and makes room for so many edges, so that adding them cannot fail. 1 on success. */
static int dgfemi_edges_reset(const dgfem_hooks *hooks, dgfemi_edges *edges, int count) {
    void *data = edges->data, *next = edges->buckets.next;
    int ok = dgfemi_mesh_room(hooks, &data, 0, &edges->capacity, count, sizeof(dgfemi_edge)) &&
             dgfemi_mesh_room(hooks, &next, 0, &edges->buckets.next_capacity, count, sizeof(int));
    edges->data = (dgfemi_edge *)data, edges->buckets.next = (int *)next;
    edges->count = 0;
    return ok && dgfemi_buckets_reset(hooks, &edges->buckets, count);
}

static void dgfemi_edges_add(const dgfem_hooks *hooks, dgfemi_edges *edges, int from, int to) {
    int a = from < to ? from : to, b = from < to ? to : from, i;
    uint64_t hash = dgfemi_hash_pair(a, b);
    dgfemi_edge *edge;
    for (i = dgfemi_buckets_first(&edges->buckets, hash); i != DGFEM_NONE; i = edges->buckets.next[i])
        if (edges->data[i].a == a && edges->data[i].b == b) break;
    if (i == DGFEM_NONE) {
        DGFEM_ASSERT(edges->count < edges->capacity && edges->count < edges->buckets.next_capacity);
        i = edges->count++;
        memset(&edges->data[i], 0, sizeof(dgfemi_edge));
        edges->data[i].a = a, edges->data[i].b = b;
        (void)dgfemi_buckets_insert(hooks, &edges->buckets, i, hash);
    }
    edge = &edges->data[i];
    if (from == a) edge->forward++;
    else edge->backward++;
}

/* Adds the edges of a face as seen from outside one of its elements (sign as dgfemi_mesh_sign). */
static void dgfemi_edges_add_face(const dgfem_mesh *mesh, dgfemi_edges *edges, int face, int sign) {
    const dgfem_face *f = &mesh->faces[face];
    int l, i;
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        int count = mesh->loops[l].count, last = loop[count - 1];
        for (i = 0; i < count; i++) {
            dgfemi_edges_add(&mesh->hooks, edges, sign > 0 ? last : loop[i], sign > 0 ? loop[i] : last);
            last = loop[i];
        }
    }
}

/* Number of loop vertices of a face: that of its edges, too. */
static int dgfemi_mesh_face_corners(const dgfem_mesh *mesh, int face) {
    const dgfem_face *f = &mesh->faces[face];
    int l, sum = 0;
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++) sum += mesh->loops[l].count;
    return sum;
}

/* ==== corners.c =================================================================================================== */

/* Corners: classes of (vertex, element) pairs connected through glued faces around the vertex, by union-find. */

/* All (vertex, element) pairs, sorted by vertex, then element; and a forest over them that becomes the corners. The
   root of a tree is its smallest pair. */
typedef struct dgfemi_corner_pairs {
    int count;
    int *start;   /* [vertex_count + 1] pairs of vertex v: start[v] <= p < start[v + 1] */
    int *element; /* [count] ascending within a vertex */
    int *parent;  /* [count] */
} dgfemi_corner_pairs;

static int dgfemi_corner_pairs_make(const dgfem_mesh *mesh, dgfemi_arena *arena, dgfemi_corner_pairs *pairs) {
    size_t vertex_count = (size_t)mesh->vertex_count;
    int *mark = (int *)dgfemi_arena_allocate(arena, vertex_count, sizeof(int));
    int *cursor = (int *)dgfemi_arena_allocate(arena, vertex_count, sizeof(int));
    int *list = (int *)dgfemi_arena_allocate(arena, (size_t)dgfemi_mesh_max_element_corners(mesh), sizeof(int));
    int e, i, v;
    pairs->start = (int *)dgfemi_arena_allocate_zero(arena, vertex_count + 1, sizeof(int));
    if (!mark || !cursor || !list || !pairs->start) return 0;
    for (v = 0; v < mesh->vertex_count; v++) mark[v] = DGFEM_NONE;
    for (e = 0; e < mesh->element_count; e++) {
        int count = dgfemi_mesh_element_vertices(mesh, e, mark, list);
        for (i = 0; i < count; i++) pairs->start[list[i] + 1]++;
    }
    for (v = 0; v < mesh->vertex_count; v++) {
        pairs->start[v + 1] += pairs->start[v];
        cursor[v] = pairs->start[v];
        mark[v] = DGFEM_NONE;
    }
    pairs->count = pairs->start[mesh->vertex_count];
    pairs->element = (int *)dgfemi_arena_allocate(arena, (size_t)pairs->count, sizeof(int));
    pairs->parent = (int *)dgfemi_arena_allocate(arena, (size_t)pairs->count, sizeof(int));
    if (!pairs->element || !pairs->parent) return 0;
    for (e = 0; e < mesh->element_count; e++) {
        int count = dgfemi_mesh_element_vertices(mesh, e, mark, list);
        for (i = 0; i < count; i++) pairs->element[cursor[list[i]]++] = e;
    }
    for (i = 0; i < pairs->count; i++) pairs->parent[i] = i;
    return 1;
}

static int dgfemi_corner_pair_find(const dgfemi_corner_pairs *pairs, int vertex, int element) {
    int low = pairs->start[vertex], high = pairs->start[vertex + 1];
    while (high - low > 1) {
        int middle = low + (high - low) / 2;
        if (pairs->element[middle] <= element) low = middle;
        else high = middle;
    }
    DGFEM_ASSERT(low < high && pairs->element[low] == element);
    return low;
}

static int dgfemi_corner_root(int *parent, int p) {
    while (parent[p] != p) p = parent[p] = parent[parent[p]];
    return p;
}

/* Joins the two elements of every glued face at each of its vertices. */
static void dgfemi_corner_pairs_join(const dgfem_mesh *mesh, dgfemi_corner_pairs *pairs) {
    int f, l, i;
    for (f = 0; f < mesh->face_count; f++) {
        const dgfem_face *face = &mesh->faces[f];
        if (face->element[1] == DGFEM_NONE || face->cut) continue;
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            for (i = 0; i < mesh->loops[l].count; i++) {
                int v = mesh->loop_vertices[mesh->loops[l].start + i];
                int a = dgfemi_corner_root(pairs->parent, dgfemi_corner_pair_find(pairs, v, face->element[0]));
                int b = dgfemi_corner_root(pairs->parent, dgfemi_corner_pair_find(pairs, v, face->element[1]));
                if (a < b) pairs->parent[b] = a;
                else pairs->parent[a] = b;
            }
    }
}

static dgfem_corners *dgfemi_corners_new(const dgfem_mesh *mesh, int count, int pair_count) {
    const dgfem_hooks *hooks = &mesh->hooks;
    dgfem_corners *corners = (dgfem_corners *)dgfemi_allocate_zero(hooks, 1, sizeof *corners);
    if (!corners) return NULL;
    corners->hooks = *hooks;
    corners->count = count;
    corners->vertex = (int *)dgfemi_allocate(hooks, (size_t)count, sizeof(int));
    corners->element_start = (int *)dgfemi_allocate_zero(hooks, (size_t)count + 1, sizeof(int));
    corners->elements = (int *)dgfemi_allocate(hooks, (size_t)pair_count, sizeof(int));
    corners->corner_start = (int *)dgfemi_allocate_zero(hooks, (size_t)mesh->element_count + 1, sizeof(int));
    corners->corners = (int *)dgfemi_allocate(hooks, (size_t)pair_count, sizeof(int));
    if (corners->vertex && corners->element_start && corners->elements && corners->corner_start && corners->corners)
        return corners;
    dgfem_corners_destroy(corners);
    return NULL;
}

/* number[p]: the corner of pair p, numbered by their smallest pairs. Returns the number of corners. */
static int dgfemi_corners_number(dgfemi_corner_pairs *pairs, int *number) {
    int p, count = 0;
    for (p = 0; p < pairs->count; p++) {
        int root = dgfemi_corner_root(pairs->parent, p);
        number[p] = root == p ? count++ : number[root];
    }
    return count;
}

static void dgfemi_corners_fill(const dgfem_mesh *mesh, const dgfemi_corner_pairs *pairs, const int *number,
                                int *cursor, dgfem_corners *corners) {
    int p, c, e, v;
    for (p = 0; p < pairs->count; p++) {
        corners->element_start[number[p] + 1]++;
        corners->corner_start[pairs->element[p] + 1]++;
    }
    for (c = 0; c < corners->count; c++) corners->element_start[c + 1] += corners->element_start[c];
    for (e = 0; e < mesh->element_count; e++) corners->corner_start[e + 1] += corners->corner_start[e];
    memcpy(cursor, corners->element_start, (size_t)corners->count * sizeof(int));
    for (v = 0; v < mesh->vertex_count; v++)
        for (p = pairs->start[v]; p < pairs->start[v + 1]; p++) {
            corners->vertex[number[p]] = v;
            corners->elements[cursor[number[p]]++] = pairs->element[p];
        }
    memcpy(cursor, corners->corner_start, (size_t)mesh->element_count * sizeof(int));
    for (c = 0; c < corners->count; c++)
        for (p = corners->element_start[c]; p < corners->element_start[c + 1]; p++)
            corners->corners[cursor[corners->elements[p]]++] = c;
}

DGFEM_API dgfem_status dgfem_mesh_corners(const dgfem_mesh *mesh, dgfem_corners **out) {
    dgfemi_corner_pairs pairs;
    dgfemi_arena arena;
    int *number, *cursor;
    if (out) *out = NULL;
    if (!mesh) return DGFEM_ERROR_ARGUMENT;
    if (!out) return dgfemi_fail(&mesh->hooks, DGFEM_ERROR_ARGUMENT, "nowhere to put the corners");
    arena = dgfemi_arena_make(&mesh->hooks);
    if (dgfemi_corner_pairs_make(mesh, &arena, &pairs)) {
        size_t most = (size_t)(pairs.count > mesh->element_count ? pairs.count : mesh->element_count);
        number = (int *)dgfemi_arena_allocate(&arena, (size_t)pairs.count, sizeof(int));
        cursor = (int *)dgfemi_arena_allocate(&arena, most, sizeof(int));
        if (number && cursor) {
            dgfemi_corner_pairs_join(mesh, &pairs);
            *out = dgfemi_corners_new(mesh, dgfemi_corners_number(&pairs, number), pairs.count);
            if (*out) dgfemi_corners_fill(mesh, &pairs, number, cursor, *out);
        }
    }
    dgfemi_arena_free(&arena);
    return *out ? DGFEM_OK : dgfemi_fail_memory(&mesh->hooks);
}

DGFEM_API void dgfem_corners_destroy(dgfem_corners *corners) {
    dgfem_hooks hooks;
    if (!corners) return;
    hooks = corners->hooks;
    dgfemi_free(&hooks, corners->vertex);
    dgfemi_free(&hooks, corners->element_start);
    dgfemi_free(&hooks, corners->elements);
    dgfemi_free(&hooks, corners->corner_start);
    dgfemi_free(&hooks, corners->corners);
    dgfemi_free(&hooks, corners);
}

/* ==== mesh_build.c ================================================================================================ */

/* Meshes from boxes, tetrahedra and polyhedra; an element as a polyhedron. */

static void dgfemi_mesh_measure(dgfem_mesh *mesh) {
    int f, e;
    for (f = 0; f < mesh->face_count; f++) dgfemi_mesh_measure_face(mesh, f);
    for (e = 0; e < mesh->element_count; e++) dgfemi_mesh_measure_element(mesh, e);
}

/* ---- grid of boxes ---- */

DGFEM_API dgfem_grid_desc dgfem_default_grid_desc(void) {
    dgfem_grid_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.upper = dgfemi_vec3(1, 1, 1);
    desc.cells[0] = desc.cells[1] = desc.cells[2] = 1;
    return desc;
}

static dgfem_real dgfemi_grid_coordinate(const dgfem_grid_desc *desc, int axis, int i) {
    dgfem_real lower = dgfemi_axis(desc->lower, axis), upper = dgfemi_axis(desc->upper, axis);
    if (i == desc->cells[axis]) return upper;
    return lower + (upper - lower) * ((dgfem_real)i / (dgfem_real)desc->cells[axis]);
}

static dgfem_status dgfemi_grid_check_axis(const dgfem_grid_desc *desc, int axis) {
    dgfem_real lower = dgfemi_axis(desc->lower, axis), upper = dgfemi_axis(desc->upper, axis);
    int i;
    if (!dgfemi_is_finite(lower) || !dgfemi_is_finite(upper) || !dgfemi_is_finite(upper - lower))
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_NOT_FINITE, "grid, axis %c: from %g to %g", "xyz"[axis],
                           (double)lower, (double)upper);
    if (!(upper > lower))
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "grid, axis %c: upper %g is not above lower %g",
                           "xyz"[axis], (double)upper, (double)lower);
    for (i = 0; i < desc->cells[axis]; i++)
        if (!(dgfemi_grid_coordinate(desc, axis, i) < dgfemi_grid_coordinate(desc, axis, i + 1)))
            return dgfemi_fail(&desc->hooks, DGFEM_ERROR_DEGENERATE, "grid, axis %c: cell %d has no width", "xyz"[axis],
                               i);
    return DGFEM_OK;
}

static dgfem_status dgfemi_grid_check(const dgfem_grid_desc *desc) {
    const int *n = desc->cells;
    double nx = (double)n[0], ny = (double)n[1], nz = (double)n[2];
    double faces = (nx + 1) * ny * nz + nx * (ny + 1) * nz + nx * ny * (nz + 1);
    dgfem_status status = DGFEM_OK;
    dgfem_real volume = 1;
    int axis;
    for (axis = 0; axis < 3; axis++)
        if (n[axis] < 1)
            return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "grid, axis %c: %d cells", "xyz"[axis], n[axis]);
    if (4 * faces > (double)INT_MAX || 6 * nx * ny * nz > (double)INT_MAX)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "grid: %d x %d x %d cells have too many faces for int",
                           n[0], n[1], n[2]);
    for (axis = 0; !status && axis < 3; axis++) {
        status = dgfemi_grid_check_axis(desc, axis);
        volume *= (dgfemi_axis(desc->upper, axis) - dgfemi_axis(desc->lower, axis)) / (dgfem_real)n[axis];
    }
    if (!status && !(volume > 0 && dgfemi_is_finite(volume)))
        status = dgfemi_fail(&desc->hooks, DGFEM_ERROR_DEGENERATE, "grid: a cell of volume %g", (double)volume);
    return status;
}

/* Index of item (i,j,k) of a box of counts[0] * counts[1] * counts[2] items. */
static int dgfemi_grid_index(const int counts[3], const int ijk[3]) {
    return ijk[0] + counts[0] * (ijk[1] + counts[1] * ijk[2]);
}

static void dgfemi_grid_add_vertices(const dgfem_grid_desc *desc, dgfem_mesh *mesh) {
    int i, j, k;
    for (k = 0; k <= desc->cells[2]; k++)
        for (j = 0; j <= desc->cells[1]; j++)
            for (i = 0; i <= desc->cells[0]; i++)
                (void)dgfemi_mesh_add_vertex(mesh, dgfemi_vec3(dgfemi_grid_coordinate(desc, 0, i),
                                                               dgfemi_grid_coordinate(desc, 1, j),
                                                               dgfemi_grid_coordinate(desc, 2, k)));
}

/* The face at the lower side of cell ijk along an axis; ijk[axis] may be one past the last cell.

        k+1  3-----2       axis, u, v in cyclic order, so that 0 1 2 3 runs counter-clockwise seen from +axis
             |     |
          k  0-----1  v
             j u  j+1                                                                                              */
static void dgfemi_grid_add_face(const dgfem_grid_desc *desc, dgfem_mesh *mesh, int axis, const int ijk[3]) {
    int u = (axis + 1) % 3, v = (axis + 2) % 3, i, loop[4], points[3], below[3], above, element0, element1, tag;
    dgfem_real side = 1;
    for (i = 0; i < 3; i++) points[i] = desc->cells[i] + 1, below[i] = ijk[i];
    below[axis]--;
    for (i = 0; i < 4; i++) {
        int corner[3];
        corner[axis] = ijk[axis];
        corner[u] = ijk[u] + (i == 1 || i == 2);
        corner[v] = ijk[v] + (i >= 2);
        loop[i] = dgfemi_grid_index(points, corner);
    }
    above = ijk[axis] < desc->cells[axis] ? dgfemi_grid_index(desc->cells, ijk) : DGFEM_NONE;
    element0 = ijk[axis] > 0 ? dgfemi_grid_index(desc->cells, below) : DGFEM_NONE;
    element1 = above;
    tag = above == DGFEM_NONE ? 2 * axis + 1 : DGFEM_NONE;
    if (element0 == DGFEM_NONE) { /* lower side of the grid: the normal points out of the only element */
        int swap = loop[1];
        loop[1] = loop[3], loop[3] = swap;
        element0 = above, element1 = DGFEM_NONE;
        tag = 2 * axis;
        side = -1;
    }
    (void)dgfemi_mesh_add_face(mesh, dgfemi_mesh_add_loop(mesh, loop, 4), 1, element0, element1, tag,
                               dgfemi_vec3(axis == 0 ? side : 0, axis == 1 ? side : 0, axis == 2 ? side : 0));
}

/* All faces across an axis. Returns the index of the first. */
static int dgfemi_grid_add_faces(const dgfem_grid_desc *desc, dgfem_mesh *mesh, int axis) {
    int first = mesh->face_count, ijk[3];
    for (ijk[2] = 0; ijk[2] < desc->cells[2] + (axis == 2); ijk[2]++)
        for (ijk[1] = 0; ijk[1] < desc->cells[1] + (axis == 1); ijk[1]++)
            for (ijk[0] = 0; ijk[0] < desc->cells[0] + (axis == 0); ijk[0]++)
                dgfemi_grid_add_face(desc, mesh, axis, ijk);
    return first;
}

static void dgfemi_grid_add_elements(const dgfem_grid_desc *desc, dgfem_mesh *mesh, const int first_face[3]) {
    int ijk[3], faces[6], counts[3], axis;
    for (ijk[2] = 0; ijk[2] < desc->cells[2]; ijk[2]++)
        for (ijk[1] = 0; ijk[1] < desc->cells[1]; ijk[1]++)
            for (ijk[0] = 0; ijk[0] < desc->cells[0]; ijk[0]++) {
                for (axis = 0; axis < 3; axis++) {
                    memcpy(counts, desc->cells, sizeof counts);
                    counts[axis]++;
                    faces[2 * axis] = first_face[axis] + dgfemi_grid_index(counts, ijk);
                    ijk[axis]++;
                    faces[2 * axis + 1] = first_face[axis] + dgfemi_grid_index(counts, ijk);
                    ijk[axis]--;
                }
                (void)dgfemi_mesh_add_element(mesh, faces, 6, mesh->element_count);
            }
}

static dgfem_status dgfemi_mesh_grid(const dgfem_grid_desc *desc, dgfem_mesh **out) {
    int nx = desc->cells[0], ny = desc->cells[1], nz = desc->cells[2], axis, first_face[3];
    int cells = nx * ny * nz, faces = (nx + 1) * ny * nz + nx * (ny + 1) * nz + nx * ny * (nz + 1);
    dgfem_mesh *mesh = dgfemi_mesh_new(&desc->hooks);
    if (!mesh ||
        !dgfemi_mesh_reserve(mesh, (nx + 1) * (ny + 1) * (nz + 1), faces, cells, faces, 4 * faces, 6 * cells)) {
        dgfem_mesh_destroy(mesh);
        return dgfemi_fail_memory(&desc->hooks);
    }
    dgfemi_grid_add_vertices(desc, mesh);
    for (axis = 0; axis < 3; axis++) first_face[axis] = dgfemi_grid_add_faces(desc, mesh, axis);
    dgfemi_grid_add_elements(desc, mesh, first_face);
    dgfemi_mesh_measure(mesh);
    *out = mesh;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mesh_create_grid(const dgfem_grid_desc *desc, dgfem_mesh **out) {
    dgfem_status status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (out) *out = NULL;
    if (status) return status;
    if (!out) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "grid: nowhere to put the mesh");
    status = dgfemi_grid_check(desc);
    return status ? status : dgfemi_mesh_grid(desc, out);
}

/* ---- faces that two elements share ---- */

/* 1 when loop b runs through the vertices of loop a, in the same order (step 1) or the opposite one (step -1). */
static int dgfemi_loops_match(const int *a, const int *b, int count, int step) {
    int r, i;
    for (r = 0; r < count; r++) {
        int at = r;
        for (i = 0; i < count && a[i] == b[at]; i++) at = at + step < 0 ? count - 1 : (at + step) % count;
        if (i == count) return 1;
    }
    return 0;
}

/* The same for two ranges of mesh->loops, in any order. */
static int dgfemi_loop_sets_match(const dgfem_mesh *mesh, int first_a, int first_b, int count, int step) {
    int i, j;
    for (i = first_a; i < first_a + count; i++) {
        dgfem_loop a = mesh->loops[i];
        for (j = first_b; j < first_b + count; j++) {
            dgfem_loop b = mesh->loops[j];
            if (a.count == b.count &&
                dgfemi_loops_match(mesh->loop_vertices + a.start, mesh->loop_vertices + b.start, a.count, step))
                break;
        }
        if (j == first_b + count) return 0;
    }
    return 1;
}

/* Does not depend on the order of the loops, on where they start or which way they run. */
static uint64_t dgfemi_loops_hash(const dgfem_mesh *mesh, int first, int count) {
    uint64_t sum = 0;
    int l, i;
    for (l = first; l < first + count; l++) {
        const int *v = mesh->loop_vertices + mesh->loops[l].start;
        int last = v[mesh->loops[l].count - 1];
        for (i = 0; i < mesh->loops[l].count; i++) {
            sum += last < v[i] ? dgfemi_hash_pair(last, v[i]) : dgfemi_hash_pair(v[i], last);
            last = v[i];
        }
    }
    return dgfemi_mix(sum);
}

/* Elements given one after the other, each as a list of oriented faces. */
typedef struct dgfemi_mesh_builder {
    dgfem_mesh *mesh;
    const char *kind;     /* what the caller calls an element */
    dgfemi_buckets faces; /* by dgfemi_loops_hash */
    dgfemi_ints element;  /* faces of the element at work */
    int first_loop;       /* of the face at work */
} dgfemi_mesh_builder;

static void dgfemi_builder_free(dgfemi_mesh_builder *builder, const dgfem_hooks *hooks) {
    dgfemi_buckets_free(hooks, &builder->faces);
    dgfemi_free(hooks, builder->element.data);
    dgfem_mesh_destroy(builder->mesh);
}

/* The face whose loops match the loops at work either way, or DGFEM_NONE. */
static int dgfemi_builder_find(const dgfemi_mesh_builder *builder, uint64_t hash, int *step) {
    const dgfem_mesh *mesh = builder->mesh;
    int loop_count = mesh->loop_count - builder->first_loop, f;
    for (f = dgfemi_buckets_first(&builder->faces, hash); f != DGFEM_NONE; f = builder->faces.next[f]) {
        if (mesh->faces[f].loop_count != loop_count) continue;
        for (*step = -1; *step <= 1; *step += 2)
            if (dgfemi_loop_sets_match(mesh, mesh->faces[f].loop_start, builder->first_loop, loop_count, *step))
                return f;
    }
    return DGFEM_NONE;
}

/* The loops at work become the other side of an earlier face, or a new boundary face of the element to come. `side` is
   the caller's number of the face within its element. */
static dgfem_status dgfemi_builder_end_face(dgfemi_mesh_builder *builder, int side) {
    dgfem_mesh *mesh = builder->mesh;
    const dgfem_hooks *hooks = &mesh->hooks;
    int loop_count = mesh->loop_count - builder->first_loop, element = mesh->element_count, step = 0;
    uint64_t hash = dgfemi_loops_hash(mesh, builder->first_loop, loop_count);
    int f = dgfemi_builder_find(builder, hash, &step);
    if (f == DGFEM_NONE) {
        f = dgfemi_mesh_add_face(mesh, builder->first_loop, loop_count, element, DGFEM_NONE, DGFEM_NONE,
                                 dgfemi_vec3(0, 0, 0));
        if (f == DGFEM_NONE || !dgfemi_buckets_insert(hooks, &builder->faces, f, hash) ||
            !dgfemi_push(hooks, &builder->element, f))
            return dgfemi_fail_memory(hooks);
        mesh->faces[f].normal = dgfemi_mesh_unit_normal(mesh, f);
        if (!(dgfemi_dot(mesh->faces[f].normal, mesh->faces[f].normal) > 0))
            return dgfemi_fail(hooks, DGFEM_ERROR_DEGENERATE, "%s %d: face %d has no area", builder->kind, element,
                               side);
        return DGFEM_OK;
    }
    if (mesh->faces[f].element[0] == element || mesh->faces[f].element[1] == element)
        return dgfemi_fail(hooks, DGFEM_ERROR_DEGENERATE, "%s %d: face %d coincides with another of its faces",
                           builder->kind, element, side);
    if (mesh->faces[f].element[1] != DGFEM_NONE)
        return dgfemi_fail(hooks, DGFEM_ERROR_NOT_CONFORMING, "%s %d: face %d is already between %d and %d",
                           builder->kind, element, side, mesh->faces[f].element[0], mesh->faces[f].element[1]);
    if (step > 0)
        return dgfemi_fail(hooks, DGFEM_ERROR_NOT_CONFORMING, "%s %d: overlaps %d, on the same side of face %d",
                           builder->kind, element, mesh->faces[f].element[0], side);
    mesh->loop_vertex_count = mesh->loops[builder->first_loop].start;
    mesh->loop_count = builder->first_loop;
    mesh->faces[f].element[1] = element;
    return dgfemi_push(hooks, &builder->element, f) ? DGFEM_OK : dgfemi_fail_memory(hooks);
}

static dgfem_status dgfemi_builder_end_element(dgfemi_mesh_builder *builder) {
    dgfem_mesh *mesh = builder->mesh;
    if (dgfemi_mesh_add_element(mesh, builder->element.data, builder->element.count, mesh->element_count) == DGFEM_NONE)
        return dgfemi_fail_memory(&mesh->hooks);
    builder->element.count = 0;
    return DGFEM_OK;
}

/* ---- tetrahedra ---- */

DGFEM_API dgfem_tetrahedra_desc dgfem_default_tetrahedra_desc(void) {
    dgfem_tetrahedra_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.vertices = dgfemi_points_in(NULL, DGFEM_NUMBER_OF_REAL, 0);
    return desc;
}

static dgfem_status dgfemi_tetrahedron_check(const dgfem_tetrahedra_desc *desc, int t) {
    const int *v = desc->tetrahedra + 4 * t;
    dgfem_vec3 p[4];
    dgfem_real longest = 0, determinant;
    int i, j;
    for (i = 0; i < 4; i++)
        if (v[i] < 0 || v[i] >= desc->vertices.count)
            return dgfemi_fail(&desc->hooks, DGFEM_ERROR_INDEX, "tetrahedron %d refers to vertex %d of %d", t, v[i],
                               desc->vertices.count);
    for (i = 0; i < 4; i++) p[i] = dgfemi_point_read(&desc->vertices, v[i]);
    for (i = 0; i < 4; i++)
        for (j = 0; j < i; j++) longest = dgfemi_max(longest, dgfemi_distance(p[i], p[j]));
    determinant = dgfemi_dot(dgfemi_sub(p[1], p[0]), dgfemi_cross(dgfemi_sub(p[2], p[0]), dgfemi_sub(p[3], p[0])));
    if (!dgfemi_is_finite(determinant) || !dgfemi_is_finite(longest))
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_NOT_FINITE, "tetrahedron %d: its volume overflows", t);
    if (!(determinant > 16 * DGFEM_EPSILON * longest * longest * longest))
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_DEGENERATE, "tetrahedron %d is %s: volume %g", t,
                           determinant < 0 ? "inverted" : "flat", (double)determinant / 6);
    return DGFEM_OK;
}

static dgfem_status dgfemi_tetrahedra_check(const dgfem_tetrahedra_desc *desc) {
    const dgfem_points_in *vertices = &desc->vertices;
    dgfem_status status = dgfemi_check_points(&desc->hooks, vertices->data, vertices->type, vertices->stride,
                                              vertices->count, "tetrahedra, vertices");
    int i;
    if (status) return status;
    if (desc->tetrahedron_count < 0 || (desc->tetrahedron_count > 0 && !desc->tetrahedra))
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "tetrahedra: no indices for %d tetrahedra",
                           desc->tetrahedron_count);
    if (desc->tetrahedron_count == 0) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_EMPTY, "no tetrahedra");
    if (desc->tetrahedron_count > INT_MAX / 12)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "%d tetrahedra have too many faces for int",
                           desc->tetrahedron_count);
    for (i = 0; i < vertices->count; i++)
        if (!dgfemi_is_finite3(dgfemi_point_read(vertices, i)))
            return dgfemi_fail(&desc->hooks, DGFEM_ERROR_NOT_FINITE, "tetrahedra: vertex %d is not finite", i);
    for (i = 0; !status && i < desc->tetrahedron_count; i++) status = dgfemi_tetrahedron_check(desc, i);
    return status;
}

static dgfem_status dgfemi_tetrahedra_build(const dgfem_tetrahedra_desc *desc, dgfemi_mesh_builder *builder) {
    static const int sides[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}; /* side i lies opposite vertex i */
    dgfem_mesh *mesh = builder->mesh;
    int n = desc->tetrahedron_count, t, i, j;
    if (!dgfemi_mesh_reserve(mesh, desc->vertices.count, 0, n, 0, 0, 4 * n) ||
        !dgfemi_buckets_reset(&desc->hooks, &builder->faces, 4 * n))
        return dgfemi_fail_memory(&desc->hooks);
    for (i = 0; i < desc->vertices.count; i++)
        (void)dgfemi_mesh_add_vertex(mesh, dgfemi_point_read(&desc->vertices, i));
    for (t = 0; t < n; t++) {
        dgfem_status status = DGFEM_OK;
        for (i = 0; !status && i < 4; i++) {
            int loop[3];
            for (j = 0; j < 3; j++) loop[j] = desc->tetrahedra[4 * t + sides[i][j]];
            builder->first_loop = mesh->loop_count;
            status = dgfemi_mesh_add_loop(mesh, loop, 3) == DGFEM_NONE ? dgfemi_fail_memory(&desc->hooks)
                                                                       : dgfemi_builder_end_face(builder, i);
        }
        if (!status) status = dgfemi_builder_end_element(builder);
        if (status) return status;
    }
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mesh_create_tetrahedra(const dgfem_tetrahedra_desc *desc, dgfem_mesh **out) {
    dgfem_status status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    dgfemi_mesh_builder builder;
    if (out) *out = NULL;
    if (status) return status;
    if (!out) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "tetrahedra: nowhere to put the mesh");
    status = dgfemi_tetrahedra_check(desc);
    if (status) return status;
    memset(&builder, 0, sizeof builder);
    builder.kind = "tetrahedron";
    builder.mesh = dgfemi_mesh_new(&desc->hooks);
    status = builder.mesh ? dgfemi_tetrahedra_build(desc, &builder) : dgfemi_fail_memory(&desc->hooks);
    if (!status) {
        dgfemi_mesh_measure(builder.mesh);
        *out = builder.mesh;
        builder.mesh = NULL;
    }
    dgfemi_builder_free(&builder, &desc->hooks);
    return status;
}

/* ---- welding ---- */

/* Mesh vertices by the cell of a cubic lattice that they lie in. Cells are at least twice the tolerance wide, so that
   what is within the tolerance of a point lies in at most eight of them. */
typedef struct dgfemi_weld {
    dgfem_mesh *mesh;
    dgfemi_buckets cells;
    dgfem_vec3 origin;
    dgfem_real tolerance, width;
} dgfemi_weld;

static int dgfemi_weld_cell(const dgfemi_weld *weld, dgfem_real x) { return (int)floor((double)(x / weld->width)); }

static uint64_t dgfemi_weld_hash(int i, int j, int k) {
    return dgfemi_mix(dgfemi_hash_pair(i, j) + (uint64_t)(unsigned)k);
}

/* The mesh vertex closest to a point, if within the tolerance, else DGFEM_NONE. */
static int dgfemi_weld_find(const dgfemi_weld *weld, dgfem_vec3 point) {
    dgfem_vec3 p = dgfemi_sub(point, weld->origin);
    dgfem_real t = weld->tolerance, closest = t;
    int i, j, k, v, found = DGFEM_NONE;
    for (k = dgfemi_weld_cell(weld, p.z - t); k <= dgfemi_weld_cell(weld, p.z + t); k++)
        for (j = dgfemi_weld_cell(weld, p.y - t); j <= dgfemi_weld_cell(weld, p.y + t); j++)
            for (i = dgfemi_weld_cell(weld, p.x - t); i <= dgfemi_weld_cell(weld, p.x + t); i++)
                for (v = dgfemi_buckets_first(&weld->cells, dgfemi_weld_hash(i, j, k)); v != DGFEM_NONE;
                     v = weld->cells.next[v]) {
                    dgfem_real d = dgfemi_distance(weld->mesh->vertices[v], point);
                    if (!(d <= closest) || (found != DGFEM_NONE && !(d < closest) && v >= found)) continue;
                    closest = d;
                    found = v;
                }
    return found;
}

/* The mesh vertex for a point, a new one where none is close; DGFEM_NONE when out of memory. */
static int dgfemi_weld_vertex(dgfemi_weld *weld, dgfem_vec3 point) {
    dgfem_vec3 p = dgfemi_sub(point, weld->origin);
    uint64_t hash =
        dgfemi_weld_hash(dgfemi_weld_cell(weld, p.x), dgfemi_weld_cell(weld, p.y), dgfemi_weld_cell(weld, p.z));
    int v = dgfemi_weld_find(weld, point);
    if (v != DGFEM_NONE) return v;
    v = dgfemi_mesh_add_vertex(weld->mesh, point);
    if (v == DGFEM_NONE) return v;
    return dgfemi_buckets_insert(&weld->mesh->hooks, &weld->cells, v, hash) ? v : DGFEM_NONE;
}

/* ---- polyhedra ---- */

#if DGFEM_REAL_IS_FLOAT
#define DGFEM_WELD_TOLERANCE DGFEM_R(1e-5)
#else
#define DGFEM_WELD_TOLERANCE DGFEM_R(1e-9)
#endif

DGFEM_API dgfem_weld_desc dgfem_default_weld_desc(void) {
    dgfem_weld_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.tolerance = DGFEM_WELD_TOLERANCE;
    return desc;
}

/* Puts the number of the polyhedron behind a message about it. */
typedef struct dgfemi_numbered_log {
    const dgfem_hooks *hooks;
    int number;
} dgfemi_numbered_log;

static void dgfemi_log_numbered(void *user, dgfem_log_level level, const char *text) {
    const dgfemi_numbered_log *log = (const dgfemi_numbered_log *)user;
    char line[600];
    snprintf(line, sizeof line, "%s (polyhedron %d)", text, log->number);
    log->hooks->log(log->hooks->log_user, level, line);
}

/* The check of one polyhedron, with the hooks of the mesh. Planar means at least to round-off and to the default
   tolerance, however fine the welding. */
static dgfem_status dgfemi_weld_check_polyhedron(const dgfem_polyhedron *polyhedron, int number,
                                                 const dgfem_weld_desc *desc) {
    dgfemi_numbered_log log;
    dgfem_polyhedron view;
    if (!polyhedron) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "polyhedron %d is NULL", number);
    view = *polyhedron;
    log.hooks = &desc->hooks;
    log.number = number;
    view.hooks = desc->hooks;
    if (desc->hooks.log) view.hooks.log = dgfemi_log_numbered, view.hooks.log_user = &log;
    return dgfem_polyhedron_check(&view, dgfemi_max(desc->tolerance, DGFEM_WELD_TOLERANCE));
}

/* Sizes and common bounding box of all polyhedra. */
static dgfem_status dgfemi_weld_measure(const dgfem_polyhedron *const *polyhedra, int count,
                                        const dgfem_weld_desc *desc, dgfemi_weld *weld, double *faces,
                                        double *vertices) {
    dgfem_vec3 lower = dgfemi_vec3(0, 0, 0), upper = lower, extent;
    dgfem_real largest;
    int p;
    for (p = 0; p < count; p++) {
        dgfem_measure measure = dgfem_polyhedron_measure(polyhedra[p]);
        lower = p ? dgfemi_min3(lower, measure.lower) : measure.lower;
        upper = p ? dgfemi_max3(upper, measure.upper) : measure.upper;
        *faces += (double)polyhedra[p]->face_count;
        *vertices += (double)polyhedra[p]->vertex_count;
    }
    if (*faces > (double)INT_MAX || *vertices > (double)INT_MAX)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "%d polyhedra have too many faces for int", count);
    extent = dgfemi_sub(upper, lower);
    largest = dgfemi_max(extent.x, dgfemi_max(extent.y, extent.z));
    if (!dgfemi_is_finite3(extent))
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_NOT_FINITE, "polyhedra: their bounding box overflows");
    weld->origin = lower;
    weld->tolerance = desc->tolerance * largest;
    weld->width = dgfemi_max(2 * weld->tolerance, largest * DGFEM_R(1e-9)); /* keeps cell numbers within int */
    return DGFEM_OK;
}

/* Appends one welded loop of a polyhedron; `map` is from its vertices to the mesh's, DGFEM_NONE where unknown. */
static dgfem_status dgfemi_weld_loop(dgfemi_weld *weld, const dgfem_polyhedron *polyhedron, int loop, int *map,
                                     int *scratch, int number) {
    const dgfem_hooks *hooks = &weld->mesh->hooks;
    const int *v = polyhedron->loop_vertices + polyhedron->loop_start[loop];
    int count = polyhedron->loop_start[loop + 1] - polyhedron->loop_start[loop], i;
    for (i = 0; i < count; i++) {
        if (map[v[i]] == DGFEM_NONE) map[v[i]] = dgfemi_weld_vertex(weld, polyhedron->vertices[v[i]]);
        if (map[v[i]] == DGFEM_NONE) return dgfemi_fail_memory(hooks);
        scratch[i] = map[v[i]];
    }
    for (i = 0; i < count; i++) {
        int next = (i + 1) % count, after = (i + 2) % count;
        if (scratch[i] == scratch[next] || scratch[i] == scratch[after])
            return dgfemi_fail(hooks, DGFEM_ERROR_DEGENERATE,
                               "polyhedron %d: welding within %g joins vertices %d and %d of one face", number,
                               (double)weld->tolerance, v[i], scratch[i] == scratch[next] ? v[next] : v[after]);
    }
    return dgfemi_mesh_add_loop(weld->mesh, scratch, count) == DGFEM_NONE ? dgfemi_fail_memory(hooks) : DGFEM_OK;
}

static dgfem_status dgfemi_weld_polyhedron(dgfemi_weld *weld, dgfemi_mesh_builder *builder,
                                           const dgfem_polyhedron *polyhedron, int *map, int *scratch) {
    int number = builder->mesh->element_count, f, l, v;
    dgfem_status status = DGFEM_OK;
    for (v = 0; v < polyhedron->vertex_count; v++) map[v] = DGFEM_NONE;
    for (f = 0; !status && f < polyhedron->face_count; f++) {
        builder->first_loop = builder->mesh->loop_count;
        for (l = polyhedron->face_loops[f]; !status && l < polyhedron->face_loops[f + 1]; l++)
            status = dgfemi_weld_loop(weld, polyhedron, l, map, scratch, number);
        if (!status) status = dgfemi_builder_end_face(builder, f);
    }
    return status ? status : dgfemi_builder_end_element(builder);
}

static dgfem_status dgfemi_weld_build(const dgfem_polyhedron *const *polyhedra, int count, const dgfem_weld_desc *desc,
                                      dgfemi_weld *weld, dgfemi_mesh_builder *builder) {
    dgfemi_arena arena = dgfemi_arena_make(&desc->hooks);
    double faces = 0, vertices = 0;
    size_t most_vertices = 0, most_corners = 0;
    int *map, *scratch, p;
    dgfem_status status = dgfemi_weld_measure(polyhedra, count, desc, weld, &faces, &vertices);
    if (status) return status;
    for (p = 0; p < count; p++) {
        size_t n = (size_t)polyhedra[p]->vertex_count;
        size_t corners = (size_t)polyhedra[p]->loop_start[polyhedra[p]->face_loops[polyhedra[p]->face_count]];
        if (n > most_vertices) most_vertices = n;
        if (corners > most_corners) most_corners = corners;
    }
    map = (int *)dgfemi_arena_allocate(&arena, most_vertices, sizeof(int));
    scratch = (int *)dgfemi_arena_allocate(&arena, most_corners, sizeof(int));
    if (!map || !scratch || !dgfemi_buckets_reset(&desc->hooks, &builder->faces, (int)faces) ||
        !dgfemi_buckets_reset(&desc->hooks, &weld->cells, (int)vertices))
        status = dgfemi_fail_memory(&desc->hooks);
    for (p = 0; !status && p < count; p++) status = dgfemi_weld_polyhedron(weld, builder, polyhedra[p], map, scratch);
    dgfemi_arena_free(&arena);
    if (status) return status;
    dgfemi_mesh_measure(builder->mesh);
    for (p = 0; p < count; p++)
        if (!(builder->mesh->elements[p].volume > 0))
            return dgfemi_fail(&desc->hooks, DGFEM_ERROR_DEGENERATE, "polyhedron %d: volume %g after welding", p,
                               (double)builder->mesh->elements[p].volume);
    return DGFEM_OK;
}

static dgfem_status dgfemi_weld_check(const dgfem_polyhedron *const *polyhedra, int count,
                                      const dgfem_weld_desc *desc) {
    dgfem_status status = DGFEM_OK;
    int p;
    if (count < 0 || (count > 0 && !polyhedra))
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "polyhedra: no array of %d polyhedra", count);
    if (count == 0) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_EMPTY, "no polyhedra");
    if (!(desc->tolerance >= 0 && desc->tolerance <= DGFEM_R(0.1)))
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "weld tolerance %g is not in 0 .. 0.1",
                           (double)desc->tolerance);
    for (p = 0; !status && p < count; p++) status = dgfemi_weld_check_polyhedron(polyhedra[p], p, desc);
    return status;
}

DGFEM_API dgfem_status dgfem_mesh_create_polyhedra(const dgfem_polyhedron *const *polyhedra, int count,
                                                   const dgfem_weld_desc *desc, dgfem_mesh **out) {
    dgfem_status status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    dgfemi_mesh_builder builder;
    dgfemi_weld weld;
    if (out) *out = NULL;
    if (status) return status;
    if (!out) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "polyhedra: nowhere to put the mesh");
    status = dgfemi_weld_check(polyhedra, count, desc);
    if (status) return status;
    memset(&builder, 0, sizeof builder);
    memset(&weld, 0, sizeof weld);
    builder.kind = "polyhedron";
    builder.mesh = weld.mesh = dgfemi_mesh_new(&desc->hooks);
    status =
        builder.mesh ? dgfemi_weld_build(polyhedra, count, desc, &weld, &builder) : dgfemi_fail_memory(&desc->hooks);
    if (!status) {
        *out = builder.mesh;
        builder.mesh = NULL;
    }
    dgfemi_buckets_free(&desc->hooks, &weld.cells);
    dgfemi_builder_free(&builder, &desc->hooks);
    return status;
}

/* ---- an element as a polyhedron ---- */

static int dgfemi_compare_ints(const void *a, const void *b) {
    int x = *(const int *)a, y = *(const int *)b;
    return (x > y) - (x < y);
}

/* Sorts and drops repeats; returns the new count. */
static int dgfemi_sort_unique(int *data, int count) {
    int i, kept = 0;
    qsort(data, (size_t)count, sizeof(int), dgfemi_compare_ints);
    for (i = 0; i < count; i++)
        if (kept == 0 || data[i] != data[kept - 1]) data[kept++] = data[i];
    return kept;
}

/* The arrays of a polyhedron at work. */
typedef struct dgfemi_outline {
    int *ids; /* mesh vertices, ascending: ids[i] becomes vertex i */
    dgfem_vec3 *vertices;
    int *face_loops, *loop_start, *loop_vertices;
    int vertex_count, loop_count, corner_count;
} dgfemi_outline;

static int dgfemi_outline_allocate(const dgfem_mesh *mesh, const dgfem_element *element, dgfemi_arena *arena,
                                   dgfemi_outline *outline) {
    size_t loops = 0, corners = 0;
    int k, l;
    for (k = element->face_start; k < element->face_start + element->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        loops += (size_t)face->loop_count;
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            corners += (size_t)mesh->loops[l].count;
    }
    memset(outline, 0, sizeof *outline);
    outline->ids = (int *)dgfemi_arena_allocate(arena, corners, sizeof(int));
    outline->vertices = (dgfem_vec3 *)dgfemi_arena_allocate(arena, corners, sizeof(dgfem_vec3));
    outline->face_loops = (int *)dgfemi_arena_allocate(arena, (size_t)element->face_count + 1, sizeof(int));
    outline->loop_start = (int *)dgfemi_arena_allocate(arena, loops + 1, sizeof(int));
    outline->loop_vertices = (int *)dgfemi_arena_allocate(arena, corners, sizeof(int));
    return outline->ids && outline->vertices && outline->face_loops && outline->loop_start && outline->loop_vertices;
}

/* Loops are copied as seen from outside the element; a reversed loop keeps its first vertex, so that fans agree. */
static void dgfemi_outline_fill(const dgfem_mesh *mesh, int e, dgfemi_outline *outline) {
    const dgfem_element *element = &mesh->elements[e];
    int k, l, i;
    outline->face_loops[0] = outline->loop_start[0] = 0;
    for (k = 0; k < element->face_count; k++) {
        int f = mesh->element_faces[element->face_start + k], sign = dgfemi_mesh_sign(mesh, e, f);
        const dgfem_face *face = &mesh->faces[f];
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
            const int *v = mesh->loop_vertices + mesh->loops[l].start;
            int count = mesh->loops[l].count;
            for (i = 0; i < count; i++)
                outline->loop_vertices[outline->corner_count++] = sign > 0 || i == 0 ? v[i] : v[count - i];
            outline->loop_start[++outline->loop_count] = outline->corner_count;
        }
        outline->face_loops[k + 1] = outline->loop_count;
    }
    memcpy(outline->ids, outline->loop_vertices, (size_t)outline->corner_count * sizeof(int));
    outline->vertex_count = dgfemi_sort_unique(outline->ids, outline->corner_count);
    for (i = 0; i < outline->vertex_count; i++) outline->vertices[i] = mesh->vertices[outline->ids[i]];
    for (i = 0; i < outline->corner_count; i++) {
        const int *found = (const int *)bsearch(&outline->loop_vertices[i], outline->ids, (size_t)outline->vertex_count,
                                                sizeof(int), dgfemi_compare_ints);
        outline->loop_vertices[i] = (int)(found - outline->ids);
    }
}

DGFEM_API dgfem_status dgfem_mesh_element_polyhedron(const dgfem_mesh *mesh, int element, dgfem_polyhedron **out) {
    dgfem_polyhedron_desc desc = dgfem_default_polyhedron_desc();
    dgfemi_outline outline;
    dgfemi_arena arena;
    dgfem_status status;
    if (out) *out = NULL;
    if (!mesh) return DGFEM_ERROR_ARGUMENT;
    if (!out) return dgfemi_fail(&mesh->hooks, DGFEM_ERROR_ARGUMENT, "nowhere to put the polyhedron");
    if (element < 0 || element >= mesh->element_count)
        return dgfemi_fail(&mesh->hooks, DGFEM_ERROR_INDEX, "element %d of %d", element, mesh->element_count);
    arena = dgfemi_arena_make(&mesh->hooks);
    if (dgfemi_outline_allocate(mesh, &mesh->elements[element], &arena, &outline)) {
        dgfemi_outline_fill(mesh, element, &outline);
        desc.vertices = outline.vertices;
        desc.vertex_count = outline.vertex_count;
        desc.face_count = mesh->elements[element].face_count;
        desc.face_loops = outline.face_loops;
        desc.loop_start = outline.loop_start;
        desc.loop_vertices = outline.loop_vertices;
        desc.hooks = mesh->hooks;
        status = dgfem_polyhedron_create(&desc, out);
    } else {
        status = dgfemi_fail_memory(&mesh->hooks);
    }
    dgfemi_arena_free(&arena);
    return status;
}

/* ==== mesh_check.c ================================================================================================ */

/* dgfem_mesh_check: every invariant of the cell complex.

   The phases run from raw indices to geometry, so that each may rely on those before. Vector areas of an element need
   no test of their own: its directed edges cancel, and each face's stored area vector is that of its loops. */

typedef struct dgfemi_mesh_checker {
    const dgfem_mesh *mesh;
    unsigned char *loop_used, *loop_vertex_used, *element_face_used; /* ranges must not overlap */
    int *face_mark;                                                  /* the last element that listed the face */
    int *face_sides;                                                 /* how many elements list it */
    dgfemi_edges edges;
} dgfemi_mesh_checker;

#define DGFEM_BROKEN(...) dgfemi_fail(&mesh->hooks, DGFEM_ERROR_INVARIANT, __VA_ARGS__)

static dgfem_status dgfemi_check_pool(const dgfem_mesh *mesh, const char *name, const void *data, int count,
                                      int capacity) {
    if (count < 0 || count > capacity || (count > 0 && !data))
        return DGFEM_BROKEN("%s: count %d, capacity %d%s", name, count, capacity, data ? "" : ", no data");
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_pools(const dgfem_mesh *mesh) {
    dgfem_status status =
        dgfemi_check_pool(mesh, "vertices", mesh->vertices, mesh->vertex_count, mesh->vertex_capacity);
    if (!status) status = dgfemi_check_pool(mesh, "faces", mesh->faces, mesh->face_count, mesh->face_capacity);
    if (!status)
        status = dgfemi_check_pool(mesh, "elements", mesh->elements, mesh->element_count, mesh->element_capacity);
    if (!status) status = dgfemi_check_pool(mesh, "loops", mesh->loops, mesh->loop_count, mesh->loop_capacity);
    if (!status)
        status = dgfemi_check_pool(mesh, "loop_vertices", mesh->loop_vertices, mesh->loop_vertex_count,
                                   mesh->loop_vertex_capacity);
    if (!status)
        status = dgfemi_check_pool(mesh, "element_faces", mesh->element_faces, mesh->element_face_count,
                                   mesh->element_face_capacity);
    if (!status && mesh->element_count == 0) status = DGFEM_BROKEN("the mesh has no elements");
    return status;
}

/* 1 when the range lies in the pool and was free; it is taken. */
static int dgfemi_take_range(unsigned char *used, int pool_count, int start, int count) {
    int i;
    if (start < 0 || count < 1 || start > pool_count || count > pool_count - start) return 0;
    for (i = start; i < start + count; i++) {
        if (used[i]) return 0;
        used[i] = 1;
    }
    return 1;
}

static dgfem_status dgfemi_check_loop(dgfemi_mesh_checker *checker, int face, int l) {
    const dgfem_mesh *mesh = checker->mesh;
    dgfem_loop loop = mesh->loops[l];
    const int *v;
    int i;
    if (loop.count < 3) return DGFEM_BROKEN("face %d: loop %d has %d vertices", face, l, loop.count);
    if (!dgfemi_take_range(checker->loop_vertex_used, mesh->loop_vertex_count, loop.start, loop.count))
        return DGFEM_BROKEN("face %d: loop %d, vertices %d + %d: out of range or shared with another loop", face, l,
                            loop.start, loop.count);
    v = mesh->loop_vertices + loop.start;
    for (i = 0; i < loop.count; i++)
        if (v[i] < 0 || v[i] >= mesh->vertex_count)
            return DGFEM_BROKEN("face %d: loop %d refers to vertex %d of %d", face, l, v[i], mesh->vertex_count);
    for (i = 0; i < loop.count; i++) {
        int next = v[(i + 1) % loop.count];
        if (v[i] == next) return DGFEM_BROKEN("face %d: loop %d has vertex %d twice in a row", face, l, next);
        if (v[i] == v[(i + 2) % loop.count])
            return DGFEM_BROKEN("face %d: loop %d runs to vertex %d and straight back", face, l, next);
    }
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_face_links(dgfemi_mesh_checker *checker, int f) {
    const dgfem_mesh *mesh = checker->mesh;
    const dgfem_face *face = &mesh->faces[f];
    dgfem_status status = DGFEM_OK;
    int l;
    if (face->element[0] < 0 || face->element[0] >= mesh->element_count || face->element[1] < DGFEM_NONE ||
        face->element[1] >= mesh->element_count)
        return DGFEM_BROKEN("face %d: elements %d and %d of %d", f, face->element[0], face->element[1],
                            mesh->element_count);
    if (face->element[0] == face->element[1])
        return DGFEM_BROKEN("face %d: element %d on both sides", f, face->element[0]);
    if (face->cut != 0 && face->cut != 1) return DGFEM_BROKEN("face %d: cut is %d", f, face->cut);
    if (!(dgfemi_abs(dgfemi_dot(face->normal, face->normal) - 1) <= 64 * DGFEM_EPSILON))
        return DGFEM_BROKEN("face %d: normal %g %g %g is not a unit vector", f, (double)face->normal.x,
                            (double)face->normal.y, (double)face->normal.z);
    if (!dgfemi_take_range(checker->loop_used, mesh->loop_count, face->loop_start, face->loop_count))
        return DGFEM_BROKEN("face %d: loops %d + %d: out of range or shared with another face", f, face->loop_start,
                            face->loop_count);
    for (l = face->loop_start; !status && l < face->loop_start + face->loop_count; l++)
        status = dgfemi_check_loop(checker, f, l);
    return status;
}

static dgfem_status dgfemi_check_element_links(dgfemi_mesh_checker *checker, int e) {
    const dgfem_mesh *mesh = checker->mesh;
    const dgfem_element *element = &mesh->elements[e];
    int k;
    if (!dgfemi_take_range(checker->element_face_used, mesh->element_face_count, element->face_start,
                           element->face_count))
        return DGFEM_BROKEN("element %d: faces %d + %d: out of range or shared with another element", e,
                            element->face_start, element->face_count);
    if (!(element->radius > 0)) /* the tolerance of its faces */
        return DGFEM_BROKEN("element %d: radius %g", e, (double)element->radius);
    for (k = element->face_start; k < element->face_start + element->face_count; k++) {
        int f = mesh->element_faces[k];
        if (f < 0 || f >= mesh->face_count)
            return DGFEM_BROKEN("element %d refers to face %d of %d", e, f, mesh->face_count);
        if (checker->face_mark[f] == e) return DGFEM_BROKEN("element %d lists face %d twice", e, f);
        if (mesh->faces[f].element[0] != e && mesh->faces[f].element[1] != e)
            return DGFEM_BROKEN("element %d lists face %d, which lies between %d and %d", e, f,
                                mesh->faces[f].element[0], mesh->faces[f].element[1]);
        checker->face_mark[f] = e;
        checker->face_sides[f]++;
    }
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_links(dgfemi_mesh_checker *checker) {
    const dgfem_mesh *mesh = checker->mesh;
    dgfem_status status = DGFEM_OK;
    int v, f, e;
    for (v = 0; v < mesh->vertex_count; v++)
        if (!dgfemi_is_finite3(mesh->vertices[v])) return DGFEM_BROKEN("vertex %d is not finite", v);
    for (f = 0; !status && f < mesh->face_count; f++) {
        checker->face_mark[f] = DGFEM_NONE;
        status = dgfemi_check_face_links(checker, f);
    }
    for (e = 0; !status && e < mesh->element_count; e++) status = dgfemi_check_element_links(checker, e);
    for (f = 0; !status && f < mesh->face_count; f++)
        if (checker->face_sides[f] != (mesh->faces[f].element[1] == DGFEM_NONE ? 1 : 2))
            status = DGFEM_BROKEN("face %d between elements %d and %d is listed by %d of them", f,
                                  mesh->faces[f].element[0], mesh->faces[f].element[1], checker->face_sides[f]);
    return status;
}

/* What round-off may do to a position in this box. Vertices made in cuts are rounded relative to their distance from
   the origin, not to the size of the element. */
static dgfem_real dgfemi_position_noise(dgfem_vec3 lower, dgfem_vec3 upper) {
    dgfem_real x = dgfemi_max(dgfemi_abs(lower.x), dgfemi_abs(upper.x));
    dgfem_real y = dgfemi_max(dgfemi_abs(lower.y), dgfemi_abs(upper.y));
    dgfem_real z = dgfemi_max(dgfemi_abs(lower.z), dgfemi_abs(upper.z));
    return 64 * DGFEM_EPSILON * dgfemi_max(x, dgfemi_max(y, z));
}

/* A face is planar when its vertices keep within this many element radii of its plane. Wide, because a plane split may
   snap vertices onto its plane without moving them. */
#define DGFEM_PLANARITY DGFEM_R(0.05)

static dgfem_real dgfemi_mesh_perimeter(const dgfem_mesh *mesh, int face) {
    const dgfem_face *f = &mesh->faces[face];
    dgfem_real sum = 0;
    int l, i;
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        dgfem_vec3 last = mesh->vertices[loop[mesh->loops[l].count - 1]];
        for (i = 0; i < mesh->loops[l].count; i++) {
            sum += dgfemi_distance(last, mesh->vertices[loop[i]]);
            last = mesh->vertices[loop[i]];
        }
    }
    return sum;
}

static dgfem_status dgfemi_check_face_shape(const dgfem_mesh *mesh, int f) {
    const dgfem_face *face = &mesh->faces[f];
    dgfem_real radius = mesh->elements[face->element[0]].radius, perimeter = dgfemi_mesh_perimeter(mesh, f);
    dgfem_real area, noise, size, off_plane;
    dgfem_vec3 lower = dgfemi_mesh_first_vertex(mesh, f), upper = lower, centre, error;
    if (face->element[1] != DGFEM_NONE) radius = dgfemi_max(radius, mesh->elements[face->element[1]].radius);
    dgfemi_mesh_face_box(mesh, f, &lower, &upper);
    noise = dgfemi_position_noise(lower, upper);
    size = dgfemi_distance(lower, upper);

    dgfemi_mesh_face_measures(mesh, f, &centre, &area);
    if (!(dgfemi_abs(area - face->area) <= noise * perimeter) || !(face->area >= 0))
        return DGFEM_BROKEN("face %d: area is %g, stored %g", f, (double)area, (double)face->area);
    if (!(dgfemi_distance(centre, face->centre) * area <= noise * perimeter * size) ||
        !(dgfemi_distance(centre, face->centre) <= size + noise))
        return DGFEM_BROKEN("face %d: centre is %g %g %g, stored %g %g %g", f, (double)centre.x, (double)centre.y,
                            (double)centre.z, (double)face->centre.x, (double)face->centre.y, (double)face->centre.z);

    off_plane = dgfemi_mesh_face_off_plane(mesh, f, face->normal, dgfemi_dot(face->normal, face->centre));
    if (!(off_plane <= DGFEM_PLANARITY * radius + noise))
        return DGFEM_BROKEN("face %d: a vertex is %g off its plane", f, (double)off_plane);
    error = dgfemi_add_scaled(dgfemi_mesh_vector_area(mesh, f), -face->area, face->normal);
    if (!(dgfemi_norm(error) <= (off_plane + noise) * perimeter))
        return DGFEM_BROKEN("face %d: its loops do not run counter-clockwise about its normal %g %g %g", f,
                            (double)face->normal.x, (double)face->normal.y, (double)face->normal.z);
    return DGFEM_OK;
}

/* A face at an edge: how far it is turned about the edge, and which way it runs along it. */
typedef struct dgfemi_fan_blade {
    dgfem_real angle; /* grows with the angle about a -> b, 0..4 */
    int direction;    /* +1 along a -> b, seen from outside the element */
} dgfemi_fan_blade;

/* In (0, 4], growing with the angle of (x, y). */
static dgfem_real dgfemi_pseudo_angle(dgfem_real x, dgfem_real y) {
    dgfem_real ratio = x / (dgfemi_abs(x) + dgfemi_abs(y));
    return y > 0 ? 2 - (1 + ratio) : 3 + ratio;
}

/* The blades of element e at an edge; returns their number, at most `capacity`. The inside of a face lies to the left
   of its loops. */
static int dgfemi_collect_blades(const dgfem_mesh *mesh, int e, const dgfemi_edge *edge, dgfemi_fan_blade *blades,
                                 int capacity) {
    const dgfem_element *element = &mesh->elements[e];
    dgfem_vec3 axis = dgfemi_normalized(dgfemi_sub(mesh->vertices[edge->b], mesh->vertices[edge->a]));
    dgfem_vec3 u = dgfemi_vec3(0, 0, 0), v = u;
    int k, l, i, count = 0;
    for (k = element->face_start; k < element->face_start + element->face_count; k++) {
        int f = mesh->element_faces[k];
        const dgfem_face *face = &mesh->faces[f];
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
            const int *loop = mesh->loop_vertices + mesh->loops[l].start;
            for (i = 0; i < mesh->loops[l].count; i++) {
                int from = loop[i], to = loop[(i + 1) % mesh->loops[l].count], along = from == edge->a ? 1 : -1;
                dgfem_vec3 inside;
                if ((from != edge->a || to != edge->b) && (from != edge->b || to != edge->a)) continue;
                if (count == capacity) return count;
                inside = dgfemi_scale((dgfem_real)along, dgfemi_cross(face->normal, axis));
                if (count == 0) u = dgfemi_normalized(inside), v = dgfemi_cross(axis, u);
                blades[count].angle = dgfemi_pseudo_angle(dgfemi_dot(inside, u), dgfemi_dot(inside, v));
                blades[count++].direction = along * dgfemi_mesh_sign(mesh, e, f);
            }
        }
    }
    return count;
}

/* An edge where an element touches itself is sound when no two faces coincide and inside and outside take turns about
   it. Counter-clockwise, the inside lies behind a face that runs backward (b) and before one that runs forward (f):

                     outside
                   f \     / b
             inside   > * <   inside
                   b /     \ f
                     outside                                                                                    */
static int dgfemi_edge_alternates(const dgfem_mesh *mesh, int e, const dgfemi_edge *edge) {
    enum { MAX_BLADES = 16 };
    dgfemi_fan_blade blades[MAX_BLADES + 1];
    int count = dgfemi_collect_blades(mesh, e, edge, blades, MAX_BLADES + 1), i, j;
    if (count > MAX_BLADES) return 1; /* too many to tell */
    for (i = 1; i < count; i++) {
        dgfemi_fan_blade blade = blades[i];
        for (j = i; j > 0 && blade.angle < blades[j - 1].angle; j--) blades[j] = blades[j - 1];
        blades[j] = blade;
    }
    for (i = 0; i < count; i++) {
        int next = (i + 1) % count;
        dgfem_real gap = blades[next].angle - blades[i].angle + (next == 0 ? 4 : 0);
        if (!(gap > 64 * DGFEM_EPSILON) || blades[i].direction == blades[next].direction) return 0;
    }
    return 1;
}

static dgfem_status dgfemi_check_element_closed(dgfemi_mesh_checker *checker, int e) {
    const dgfem_mesh *mesh = checker->mesh;
    const dgfem_element *element = &mesh->elements[e];
    int k, i, corners = 0;
    for (k = element->face_start; k < element->face_start + element->face_count; k++)
        corners += dgfemi_mesh_face_corners(mesh, mesh->element_faces[k]);
    if (!dgfemi_edges_reset(&mesh->hooks, &checker->edges, corners)) return dgfemi_fail_memory(&mesh->hooks);
    for (k = element->face_start; k < element->face_start + element->face_count; k++) {
        int f = mesh->element_faces[k];
        dgfemi_edges_add_face(mesh, &checker->edges, f, dgfemi_mesh_sign(mesh, e, f));
    }
    for (i = 0; i < checker->edges.count; i++) {
        const dgfemi_edge *edge = &checker->edges.data[i];
        if (edge->forward != edge->backward || (edge->forward > 1 && !dgfemi_edge_alternates(mesh, e, edge)))
            return DGFEM_BROKEN("element %d: edge from vertex %d to %d occurs %d times, its opposite %d times", e,
                                edge->a, edge->b, edge->forward, edge->backward);
    }
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_element_shape(const dgfem_mesh *mesh, int e) {
    const dgfem_element *element = &mesh->elements[e];
    dgfem_vec3 lower, upper, centre;
    dgfem_real volume, noise, size, radius, area = 0;
    int k;
    dgfemi_mesh_element_box(mesh, e, &lower, &upper);
    noise = dgfemi_position_noise(lower, upper);
    size = dgfemi_distance(lower, upper);
    for (k = element->face_start; k < element->face_start + element->face_count; k++)
        area += mesh->faces[mesh->element_faces[k]].area;

    dgfemi_mesh_element_measures(mesh, e, lower, upper, &centre, &volume);
    if (!(element->volume > 0)) return DGFEM_BROKEN("element %d: volume %g", e, (double)element->volume);
    if (!(dgfemi_abs(volume - element->volume) <= noise * area))
        return DGFEM_BROKEN("element %d: volume is %g, stored %g", e, (double)volume, (double)element->volume);
    if (!(dgfemi_distance(centre, element->centre) * element->volume <= noise * area * size) ||
        !(dgfemi_distance(centre, element->centre) <= size + noise))
        return DGFEM_BROKEN("element %d: centre is %g %g %g, stored %g %g %g", e, (double)centre.x, (double)centre.y,
                            (double)centre.z, (double)element->centre.x, (double)element->centre.y,
                            (double)element->centre.z);
    radius = dgfemi_mesh_element_reach(mesh, e, element->centre);
    if (!(dgfemi_abs(radius - element->radius) <= noise))
        return DGFEM_BROKEN("element %d: radius is %g, stored %g", e, (double)radius, (double)element->radius);
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_phases(dgfemi_mesh_checker *checker) {
    const dgfem_mesh *mesh = checker->mesh;
    dgfem_status status = dgfemi_check_links(checker);
    int f, e;
    for (e = 0; !status && e < mesh->element_count; e++) status = dgfemi_check_element_closed(checker, e);
    for (f = 0; !status && f < mesh->face_count; f++) status = dgfemi_check_face_shape(mesh, f);
    for (e = 0; !status && e < mesh->element_count; e++) status = dgfemi_check_element_shape(mesh, e);
    return status;
}

#undef DGFEM_BROKEN

DGFEM_API dgfem_status dgfem_mesh_check(const dgfem_mesh *mesh) {
    dgfemi_mesh_checker checker;
    dgfemi_arena arena;
    dgfem_status status;
    if (!mesh) return DGFEM_ERROR_ARGUMENT;
    status = dgfemi_check_pools(mesh);
    if (status) return status;
    memset(&checker, 0, sizeof checker);
    arena = dgfemi_arena_make(&mesh->hooks);
    checker.mesh = mesh;
    checker.loop_used = (unsigned char *)dgfemi_arena_allocate_zero(&arena, (size_t)mesh->loop_count, 1);
    checker.loop_vertex_used = (unsigned char *)dgfemi_arena_allocate_zero(&arena, (size_t)mesh->loop_vertex_count, 1);
    checker.element_face_used =
        (unsigned char *)dgfemi_arena_allocate_zero(&arena, (size_t)mesh->element_face_count, 1);
    checker.face_mark = (int *)dgfemi_arena_allocate(&arena, (size_t)mesh->face_count, sizeof(int));
    checker.face_sides = (int *)dgfemi_arena_allocate_zero(&arena, (size_t)mesh->face_count, sizeof(int));
    if (checker.loop_used && checker.loop_vertex_used && checker.element_face_used && checker.face_mark &&
        checker.face_sides)
        status = dgfemi_check_phases(&checker);
    else status = dgfemi_fail_memory(&mesh->hooks);
    dgfemi_edges_free(&mesh->hooks, &checker.edges);
    dgfemi_arena_free(&arena);
    return status;
}

/* ==== mesh_merge.c ================================================================================================ */

/* dgfem_mesh_merge_slivers: small elements vanish into a neighbour. */

/* A small element; the entry is stale when the element has gone or grown since. */
typedef struct dgfemi_sliver {
    dgfem_real volume;
    int element;
} dgfemi_sliver;

typedef struct dgfemi_merger {
    dgfem_mesh *mesh;
    dgfem_real limit;
    dgfemi_sliver *heap; /* the smallest first */
    int heap_count;
    int *mark;              /* [element_count] the last `stamp` at which the element was seen as a neighbour */
    dgfem_real *glued_area; /* [element_count] shared with the sliver at work; negative: not a candidate */
    int stamp;
    dgfemi_ints neighbours; /* of the sliver at work */
    dgfemi_ints faces;      /* of the union at work */
    dgfemi_edges edges;
} dgfemi_merger;

/* ---- heap ---- */

/* Equal volumes go by index, so that the result does not depend on the heap. */
static int dgfemi_sliver_less(dgfemi_sliver a, dgfemi_sliver b) {
    return a.volume < b.volume || (!(b.volume < a.volume) && a.element < b.element);
}

/* There is room: each push follows a pop or the counting of small elements. */
static void dgfemi_heap_push(dgfemi_merger *merger, int element) {
    dgfemi_sliver item;
    int i = merger->heap_count++;
    item.volume = merger->mesh->elements[element].volume;
    item.element = element;
    for (; i > 0 && dgfemi_sliver_less(item, merger->heap[(i - 1) / 2]); i = (i - 1) / 2)
        merger->heap[i] = merger->heap[(i - 1) / 2];
    merger->heap[i] = item;
}

static dgfemi_sliver dgfemi_heap_pop(dgfemi_merger *merger) {
    dgfemi_sliver top = merger->heap[0], item = merger->heap[--merger->heap_count];
    int i = 0, child;
    for (child = 1; child < merger->heap_count; child = 2 * i + 1) {
        if (child + 1 < merger->heap_count && dgfemi_sliver_less(merger->heap[child + 1], merger->heap[child])) child++;
        if (!dgfemi_sliver_less(merger->heap[child], item)) break;
        merger->heap[i] = merger->heap[child];
        i = child;
    }
    merger->heap[i] = item;
    return top;
}

/* ---- neighbours ---- */

static int dgfemi_mesh_other_side(const dgfem_mesh *mesh, int element, int face) {
    const dgfem_face *f = &mesh->faces[face];
    return f->element[0] == element ? f->element[1] : f->element[0];
}

/* Lists the neighbours of an element with their glued areas. 1 on success, 0 when out of memory. */
static int dgfemi_merger_list_neighbours(dgfemi_merger *merger, int element) {
    const dgfem_mesh *mesh = merger->mesh;
    const dgfem_element *e = &mesh->elements[element];
    int k;
    merger->neighbours.count = 0;
    merger->stamp++;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        int f = mesh->element_faces[k], other = dgfemi_mesh_other_side(mesh, element, f);
        if (other == DGFEM_NONE) continue;
        if (merger->mark[other] != merger->stamp) {
            merger->mark[other] = merger->stamp;
            merger->glued_area[other] = 0;
            if (!dgfemi_push(&mesh->hooks, &merger->neighbours, other)) return 0;
        }
        if (mesh->faces[f].cut) merger->glued_area[other] = -1; /* a face cannot have one element on both sides */
        if (merger->glued_area[other] >= 0) merger->glued_area[other] += mesh->faces[f].area;
    }
    return 1;
}

/* The neighbour with the largest positive glued area; of equal ones that with the lowest index. */
static int dgfemi_merger_best_neighbour(const dgfemi_merger *merger) {
    dgfem_real largest = 0;
    int i, best = DGFEM_NONE;
    for (i = 0; i < merger->neighbours.count; i++) {
        int n = merger->neighbours.data[i];
        dgfem_real area = merger->glued_area[n];
        if (area > largest || (best != DGFEM_NONE && !(area < largest) && n < best)) best = n, largest = area;
    }
    return best;
}

/* ---- unions ---- */

/* Lists the faces of `element` that it does not share with `other`. 1 on success, 0 when out of memory. */
static int dgfemi_merger_list_faces(dgfemi_merger *merger, int element, int other) {
    const dgfem_mesh *mesh = merger->mesh;
    const dgfem_element *e = &mesh->elements[element];
    int k;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        int f = mesh->element_faces[k];
        if (dgfemi_mesh_other_side(mesh, element, f) == other) continue;
        if (!dgfemi_push(&mesh->hooks, &merger->faces, f)) return 0;
    }
    return 1;
}

/* Adds the edges of the listed faces first <= i < last, which belong to one element. */
static void dgfemi_merger_add_edges(dgfemi_merger *merger, int first, int last, int element) {
    int i;
    for (i = first; i < last; i++) {
        int f = merger->faces.data[i];
        dgfemi_edges_add_face(merger->mesh, &merger->edges, f, dgfemi_mesh_sign(merger->mesh, element, f));
    }
}

/* Lists the faces of the union. *valid: it has any, a positive volume, and every edge that the sliver brings occurs
   once in either direction. The last fails where the two touch along an edge (*) away from the faces that they share:

        +---+---+
        | n |   |        seen along the edge; s and n share a face elsewhere, and their union would have the
        +---*---+        edge twice in either direction
        |   | s |
        +---+---+                                                                                               */
static int dgfemi_merger_try(dgfemi_merger *merger, int sliver, int into, int *valid) {
    const dgfem_mesh *mesh = merger->mesh;
    int i, corners = 0, from_into, from_sliver;
    *valid = 0;
    merger->faces.count = 0;
    if (!dgfemi_merger_list_faces(merger, into, sliver)) return 0;
    from_into = merger->faces.count;
    if (!dgfemi_merger_list_faces(merger, sliver, into)) return 0;
    for (i = 0; i < merger->faces.count; i++) corners += dgfemi_mesh_face_corners(mesh, merger->faces.data[i]);
    if (!dgfemi_edges_reset(&mesh->hooks, &merger->edges, corners)) return 0;
    dgfemi_merger_add_edges(merger, from_into, merger->faces.count, sliver);
    from_sliver = merger->edges.count;
    dgfemi_merger_add_edges(merger, 0, from_into, into);
    if (merger->faces.count == 0) return 1;
    if (!(mesh->elements[sliver].volume + mesh->elements[into].volume > 0)) return 1;
    for (i = 0; i < from_sliver; i++)
        if (merger->edges.data[i].forward != 1 || merger->edges.data[i].backward != 1) return 1;
    *valid = 1;
    return 1;
}

/* Makes the union listed by dgfemi_merger_try of `into`. 1 on success, 0 when out of memory. */
static int dgfemi_merger_apply(dgfemi_merger *merger, int sliver, int into) {
    dgfem_mesh *mesh = merger->mesh;
    dgfem_element *from = &mesh->elements[sliver], *to = &mesh->elements[into];
    int start = dgfemi_mesh_append(&mesh->hooks, &mesh->element_faces, &mesh->element_face_count,
                                   &mesh->element_face_capacity, merger->faces.data, merger->faces.count);
    int k;
    if (start == DGFEM_NONE) return 0;
    for (k = from->face_start; k < from->face_start + from->face_count; k++) {
        dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        if (face->element[0] == into || face->element[1] == into) face->element[0] = face->element[1] = DGFEM_NONE;
        else face->element[face->element[0] == sliver ? 0 : 1] = into;
    }
    from->face_count = 0;
    to->face_start = start;
    to->face_count = merger->faces.count;
    dgfemi_mesh_measure_element(mesh, into);
    return 1;
}

/* *into: the neighbour that took the sliver in, or DGFEM_NONE. 1 on success, 0 when out of memory. */
static int dgfemi_merger_merge(dgfemi_merger *merger, int sliver, int *into) {
    int valid = 0;
    if (!dgfemi_merger_list_neighbours(merger, sliver)) return 0;
    for (;;) {
        *into = dgfemi_merger_best_neighbour(merger);
        if (*into == DGFEM_NONE) return 1;
        if (!dgfemi_merger_try(merger, sliver, *into, &valid)) return 0;
        if (valid) return dgfemi_merger_apply(merger, sliver, *into);
        merger->glued_area[*into] = -1;
    }
}

/* ---- all slivers ---- */

/* One round over all small elements. 1 on success, 0 when out of memory. */
static int dgfemi_merger_round(dgfemi_merger *merger, int *merged) {
    dgfem_mesh *mesh = merger->mesh;
    int e, into;
    *merged = 0;
    for (e = 0; e < mesh->element_count; e++)
        if (mesh->elements[e].face_count > 0 && mesh->elements[e].volume < merger->limit) dgfemi_heap_push(merger, e);
    while (merger->heap_count > 0) {
        dgfemi_sliver sliver = dgfemi_heap_pop(merger);
        const dgfem_element *element = &mesh->elements[sliver.element];
        if (element->face_count == 0 || element->volume < sliver.volume || element->volume > sliver.volume) continue;
        if (!dgfemi_merger_merge(merger, sliver.element, &into)) return 0;
        if (into == DGFEM_NONE) continue;
        ++*merged;
        if (mesh->elements[into].volume < merger->limit) dgfemi_heap_push(merger, into);
    }
    return 1;
}

static int dgfemi_mesh_count_slivers(const dgfem_mesh *mesh, dgfem_real limit) {
    int e, count = 0;
    for (e = 0; e < mesh->element_count; e++)
        if (mesh->elements[e].face_count > 0 && mesh->elements[e].volume < limit) count++;
    return count;
}

/* Rounds until one changes nothing: a merge may give an earlier sliver a neighbour that can take it. Works in place
   and leaves dead items. 1 on success, 0 when out of memory. */
static int dgfemi_merger_run(dgfemi_merger *merger, int *merged, int *left) {
    dgfem_mesh *mesh = merger->mesh;
    dgfemi_arena arena = dgfemi_arena_make(&mesh->hooks);
    size_t n = (size_t)mesh->element_count;
    int ok, round = 0;
    *left = dgfemi_mesh_count_slivers(mesh, merger->limit);
    merger->heap = (dgfemi_sliver *)dgfemi_arena_allocate(&arena, (size_t)*left, sizeof(dgfemi_sliver));
    merger->mark = (int *)dgfemi_arena_allocate_zero(&arena, n, sizeof(int));
    merger->glued_area = (dgfem_real *)dgfemi_arena_allocate(&arena, n, sizeof(dgfem_real));
    ok = merger->heap && merger->mark && merger->glued_area;
    for (*merged = 0; ok && *left > 0; *merged += round) {
        ok = dgfemi_merger_round(merger, &round);
        *left = dgfemi_mesh_count_slivers(mesh, merger->limit);
        if (round == 0) break;
    }
    dgfemi_free(&mesh->hooks, merger->neighbours.data);
    dgfemi_free(&mesh->hooks, merger->faces.data);
    dgfemi_edges_free(&mesh->hooks, &merger->edges);
    dgfemi_arena_free(&arena);
    return ok;
}

/* On a copy, so that a failure leaves the mesh as it was. */
static dgfem_status dgfemi_mesh_merge(dgfem_mesh *mesh, dgfem_real limit, int *merged, int *left) {
    dgfemi_merger merger;
    dgfem_status status;
    memset(&merger, 0, sizeof merger);
    merger.mesh = dgfemi_mesh_duplicate(mesh);
    merger.limit = limit;
    if (merger.mesh && dgfemi_merger_run(&merger, merged, left)) status = dgfemi_mesh_compact(merger.mesh);
    else status = dgfemi_fail_memory(&mesh->hooks);
    if (!status) dgfemi_mesh_swap(mesh, merger.mesh);
    dgfem_mesh_destroy(merger.mesh);
    return status;
}

DGFEM_API dgfem_status dgfem_mesh_merge_slivers(dgfem_mesh *mesh, dgfem_real volume, int *merged, int *left) {
    dgfem_status status = DGFEM_OK;
    int went = 0, stayed = 0;
    if (!mesh) return DGFEM_ERROR_ARGUMENT;
    if (!(volume >= 0) || !dgfemi_is_finite(volume))
        return dgfemi_fail(&mesh->hooks, DGFEM_ERROR_ARGUMENT, "merge slivers: volume %g", (double)volume);
    if (dgfemi_mesh_count_slivers(mesh, volume) > 0) status = dgfemi_mesh_merge(mesh, volume, &went, &stayed);
    if (status) return status;
    if (merged) *merged = went;
    if (left) *left = stayed;
    return DGFEM_OK;
}

/* ==== parts.c ===================================================================================================== */

/* Components, connected over edges, of a set of oriented faces; voids find the component that encloses them.

   A set of faces is a list of codes 2 * face + (1 where the face's normal points inwards). */

/* ---- map from edges to indices ---- */

typedef struct dgfemi_edge_slot {
    int a, b; /* a < b */
    int value;
    unsigned generation;
} dgfemi_edge_slot;

/* Open addressing. A slot of an older generation is empty, so that emptying the map costs nothing. */
typedef struct dgfemi_edge_map {
    dgfemi_edge_slot *slots;
    size_t capacity, size; /* allocated and in use, powers of two */
    size_t count;
    unsigned generation;
} dgfemi_edge_map;

/* Empties the map and fits it to about so many edges. 1 on success, 0 when out of memory. */
static int dgfemi_edge_map_begin(const dgfem_hooks *hooks, dgfemi_edge_map *map, size_t expected) {
    size_t size = 16;
    while (size < 2 * expected) size *= 2;
    map->count = 0;
    if (size > map->capacity) {
        dgfemi_edge_slot *slots = (dgfemi_edge_slot *)dgfemi_allocate_zero(hooks, size, sizeof(dgfemi_edge_slot));
        if (!slots) return 0;
        dgfemi_free(hooks, map->slots);
        map->slots = slots, map->capacity = size, map->generation = 0;
    }
    map->size = size;
    if (++map->generation == 0) {
        memset(map->slots, 0, map->capacity * sizeof(dgfemi_edge_slot));
        map->generation = 1;
    }
    return 1;
}

static int dgfemi_edge_map_has(const dgfemi_edge_map *map, const dgfemi_edge_slot *slot) {
    return slot->generation == map->generation;
}

/* The slot of the edge, or the empty one where it belongs. */
static dgfemi_edge_slot *dgfemi_edge_map_at(const dgfemi_edge_map *map, int a, int b) {
    int low = a < b ? a : b, high = a < b ? b : a;
    size_t i = (size_t)dgfemi_hash_pair(low, high) & (map->size - 1);
    while (map->slots[i].generation == map->generation && (map->slots[i].a != low || map->slots[i].b != high))
        i = (i + 1) & (map->size - 1);
    return &map->slots[i];
}

static void dgfemi_edge_map_fill(dgfemi_edge_map *map, dgfemi_edge_slot *slot, int a, int b, int value) {
    slot->a = a < b ? a : b, slot->b = a < b ? b : a;
    slot->value = value;
    slot->generation = map->generation;
    map->count++;
}

/* Fills an empty slot, then sees to it that at least half of the slots are empty: slots may move. 1 on success. */
static int dgfemi_edge_map_set(const dgfem_hooks *hooks, dgfemi_edge_map *map, dgfemi_edge_slot *slot, int a, int b,
                               int value) {
    dgfemi_edge_map grown = *map;
    size_t i;
    dgfemi_edge_map_fill(map, slot, a, b, value);
    if (2 * map->count <= map->size) return 1;
    grown.capacity = grown.size = 2 * map->size;
    grown.count = 0;
    grown.slots = (dgfemi_edge_slot *)dgfemi_allocate_zero(hooks, grown.size, sizeof(dgfemi_edge_slot));
    if (!grown.slots) return 0;
    for (i = 0; i < map->size; i++) {
        const dgfemi_edge_slot *old = &map->slots[i];
        if (!dgfemi_edge_map_has(map, old)) continue;
        dgfemi_edge_map_fill(&grown, dgfemi_edge_map_at(&grown, old->a, old->b), old->a, old->b, old->value);
    }
    dgfemi_free(hooks, map->slots);
    *map = grown;
    return 1;
}

/* ---- components ---- */

/* Zeroed memory with `mesh` set is a valid one; it serves many sets. */
typedef struct dgfemi_parts {
    const dgfem_mesh *mesh;
    const int *codes;       /* the set at hand */
    int code_count;
    int count;              /* number of components */
    int crowded;            /* 1: some edge has more than two faces */
    int *component;         /* [code_count] numbered in the order of their first faces */
    int *parent;            /* [code_count] union-find */
    dgfem_real *volume;     /* [count] once measured */
    int component_capacity, parent_capacity, volume_capacity;
    dgfemi_edge_map edges;  /* edge -> position in the set */
} dgfemi_parts;

static void dgfemi_parts_free(dgfemi_parts *c) {
    const dgfem_hooks *hooks = &c->mesh->hooks;
    dgfemi_free(hooks, c->component);
    dgfemi_free(hooks, c->parent);
    dgfemi_free(hooks, c->volume);
    dgfemi_free(hooks, c->edges.slots);
}

/* Joins face k of the set with those that it shares edges with. 1 on success, 0 when out of memory. */
static int dgfemi_parts_join(dgfemi_parts *c, int k) {
    const dgfem_mesh *mesh = c->mesh;
    const dgfem_face *face = &mesh->faces[c->codes[k] / 2];
    int l, i;
    for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        int count = mesh->loops[l].count, last = loop[count - 1];
        for (i = 0; i < count; i++) {
            dgfemi_edge_slot *slot = dgfemi_edge_map_at(&c->edges, last, loop[i]);
            if (dgfemi_edge_map_has(&c->edges, slot)) {
                int other = slot->value < 0 ? ~slot->value : slot->value; /* ~: has two faces */
                int a = dgfemi_root(c->parent, other), b = dgfemi_root(c->parent, k);
                c->parent[a > b ? a : b] = a > b ? b : a;
                c->crowded |= slot->value < 0;
                slot->value = ~other;
            } else if (!dgfemi_edge_map_set(&mesh->hooks, &c->edges, slot, last, loop[i], k)) {
                return 0;
            }
            last = loop[i];
        }
    }
    return 1;
}

/* 1 on success, 0 when out of memory. */
static int dgfemi_parts_find(dgfemi_parts *c, const dgfemi_ints *codes) {
    const dgfem_mesh *mesh = c->mesh;
    void *component = c->component, *parent = c->parent;
    size_t corners = 0;
    int k, ok = dgfemi_mesh_room(&mesh->hooks, &component, 0, &c->component_capacity, codes->count, sizeof(int));
    c->component = (int *)component;
    ok = ok && dgfemi_mesh_room(&mesh->hooks, &parent, 0, &c->parent_capacity, codes->count, sizeof(int));
    c->parent = (int *)parent;
    if (!ok) return 0;
    c->codes = codes->data;
    c->code_count = codes->count;
    c->crowded = 0;
    for (k = 0; k < c->code_count; k++) {
        c->parent[k] = k;
        corners += (size_t)dgfemi_mesh_face_corners(mesh, c->codes[k] / 2);
    }
    if (!dgfemi_edge_map_begin(&mesh->hooks, &c->edges, corners / 2 + 1)) return 0;
    for (k = 0; k < c->code_count; k++)
        if (!dgfemi_parts_join(c, k)) return 0;
    for (c->count = 0, k = 0; k < c->code_count; k++) {
        int root = dgfemi_root(c->parent, k);
        c->component[k] = root == k ? c->count++ : c->component[root];
    }
    return 1;
}

/* The first face of a component. */
static int dgfemi_parts_first(const dgfemi_parts *c, int component) {
    int k = 0;
    while (c->component[k] != component) k++;
    return c->codes[k] / 2;
}

/* By the same operations as dgfemi_mesh_element_measures. */
static dgfem_real dgfemi_parts_measure_one(const dgfemi_parts *c, int component) {
    dgfem_vec3 lower = dgfemi_mesh_first_vertex(c->mesh, dgfemi_parts_first(c, component)), upper = lower;
    dgfem_vec3 origin, moment = dgfemi_vec3(0, 0, 0);
    dgfem_real six = 0;
    int k;
    for (k = 0; k < c->code_count; k++)
        if (c->component[k] == component) dgfemi_mesh_face_box(c->mesh, c->codes[k] / 2, &lower, &upper);
    origin = dgfemi_add_scaled(lower, DGFEM_R(0.5), dgfemi_sub(upper, lower));
    for (k = 0; k < c->code_count; k++)
        if (c->component[k] == component)
            dgfemi_mesh_add_fan(c->mesh, c->codes[k] / 2, c->codes[k] % 2 ? DGFEM_R(-1) : DGFEM_R(1), origin, &six,
                                &moment);
    return six / 6;
}

/* Fills c->volume. 1 on success, 0 when out of memory. */
static int dgfemi_parts_measure(dgfemi_parts *c) {
    void *volume = c->volume;
    int i, ok = dgfemi_mesh_room(&c->mesh->hooks, &volume, 0, &c->volume_capacity, c->count, sizeof(dgfem_real));
    c->volume = (dgfem_real *)volume;
    for (i = 0; ok && i < c->count; i++) c->volume[i] = dgfemi_parts_measure_one(c, i);
    return ok;
}

/* ---- voids ---- */

/* Solid angle of a triangle seen from the origin, positive when the triangle runs clockwise from there: seen from
   inside, as the faces of a solid do. */
static double dgfemi_solid_angle(dgfem_vec3 a, dgfem_vec3 b, dgfem_vec3 c) {
    double la = (double)dgfemi_norm(a), lb = (double)dgfemi_norm(b), lc = (double)dgfemi_norm(c);
    double y = (double)dgfemi_dot(a, dgfemi_cross(b, c));
    double x = la * lb * lc + (double)dgfemi_dot(a, b) * lc + (double)dgfemi_dot(b, c) * la +
               (double)dgfemi_dot(c, a) * lb;
    return y > 0 || y < 0 ? 2 * atan2(y, x) : 0;
}

/* How often a component winds around a point. */
static double dgfemi_parts_winding(const dgfemi_parts *c, int component, dgfem_vec3 point) {
    const dgfem_mesh *mesh = c->mesh;
    double sum = 0;
    int k, l, i;
    for (k = 0; k < c->code_count; k++) {
        const dgfem_face *face = &mesh->faces[c->codes[k] / 2];
        double sign = c->codes[k] % 2 ? -1 : 1;
        if (c->component[k] != component) continue;
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
            const int *loop = mesh->loop_vertices + mesh->loops[l].start;
            dgfem_vec3 p = dgfemi_sub(mesh->vertices[loop[0]], point), q = dgfemi_sub(mesh->vertices[loop[1]], point);
            for (i = 2; i < mesh->loops[l].count; i++) {
                dgfem_vec3 r = dgfemi_sub(mesh->vertices[loop[i]], point);
                sum += sign * dgfemi_solid_angle(p, q, r);
                q = r;
            }
        }
    }
    return sum / 12.566370614359172; /* 4 pi */
}

/* The smallest component of positive volume around a void; DGFEM_NONE when there is none. */
static int dgfemi_parts_host(const dgfemi_parts *c, int hollow) {
    dgfem_vec3 point = dgfemi_mesh_first_vertex(c->mesh, dgfemi_parts_first(c, hollow));
    int i, host = DGFEM_NONE;
    for (i = 0; i < c->count; i++) {
        if (!(c->volume[i] > 0) || (host != DGFEM_NONE && !(c->volume[i] < c->volume[host]))) continue;
        if (dgfemi_parts_winding(c, i, point) > 0.25) host = i;
    }
    return host;
}

/* Gives every component of negative volume, a void, to the one that encloses it: its faces get that one's number, and
   its volume becomes zero. The components must have been measured. */
static dgfem_status dgfemi_parts_attach_voids(dgfemi_parts *c) {
    int i, k;
    for (i = 0; i < c->count; i++) {
        int host;
        if (!(c->volume[i] < 0)) continue;
        host = dgfemi_parts_host(c, i);
        if (host == DGFEM_NONE) {
            const dgfem_face *face = &c->mesh->faces[dgfemi_parts_first(c, i)];
            return dgfemi_fail(&c->mesh->hooks, DGFEM_ERROR_INSIDE_OUT,
                               "a part of volume %g at the face with tag %d is enclosed by nothing",
                               (double)c->volume[i], face->tag);
        }
        for (k = 0; k < c->code_count; k++)
            if (c->component[k] == i) c->component[k] = host;
        c->volume[i] = 0;
    }
    return DGFEM_OK;
}

/* ==== join.c ====================================================================================================== */

/* Directed edges in a plane -> closed loops -> regions, each one outer loop with its holes. */

#define DGFEM_SEGMENT_USED (-2)

/* A directed edge between two vertices; `next` chains those that leave the same vertex. */
typedef struct dgfemi_segment {
    int from, to, next;
} dgfemi_segment;

typedef struct dgfemi_segments {
    dgfemi_segment *data;
    int count, capacity;
} dgfemi_segments;

typedef struct dgfemi_segment_head {
    unsigned generation;
    int first;
} dgfemi_segment_head;

/* Zeroed memory with `mesh` set is a valid one. It serves many planes: what it allocates is kept. */
typedef struct dgfemi_joiner {
    const dgfem_mesh *mesh;
    int axis_u, axis_v;         /* the two coordinates looked at, right-handed about the normal */
    dgfemi_segment_head *heads; /* [vertex_count] first segment that leaves the vertex */
    int heads_capacity;
    unsigned generation;        /* of valid heads */
    dgfemi_ints start;          /* loop l: start[l] <= i < start[l + 1] */
    dgfemi_ints vertices;
    dgfemi_ints owner;          /* [loops] the loop whose region it belongs to */
} dgfemi_joiner;

static void dgfemi_joiner_free(dgfemi_joiner *joiner) {
    const dgfem_hooks *hooks = &joiner->mesh->hooks;
    dgfemi_free(hooks, joiner->heads);
    dgfemi_free(hooks, joiner->start.data);
    dgfemi_free(hooks, joiner->vertices.data);
    dgfemi_free(hooks, joiner->owner.data);
}

/* Makes an array hold `needed` items; new ones are zero. 1 on success, 0 when out of memory. */
static int dgfemi_fit_zero(const dgfem_hooks *hooks, void **data, int *capacity, int needed, size_t size) {
    int old = *capacity;
    void *grown;
    if (needed <= old) return 1;
    grown = dgfemi_grow(hooks, *data, capacity, needed, size);
    if (!grown) return 0;
    *data = grown;
    memset((char *)grown + (size_t)old * size, 0, (size_t)(*capacity - old) * size);
    return 1;
}

static int dgfemi_segment_push(const dgfem_hooks *hooks, dgfemi_segments *segments, int from, int to) {
    dgfemi_segment *segment;
    if (segments->count == segments->capacity) {
        void *grown = dgfemi_grow(hooks, segments->data, &segments->capacity, segments->count + 1,
                                  sizeof(dgfemi_segment));
        if (!grown) return 0;
        segments->data = (dgfemi_segment *)grown;
    }
    segment = &segments->data[segments->count++];
    segment->from = from, segment->to = to, segment->next = DGFEM_NONE;
    return 1;
}

/* ---- loops ---- */

static dgfem_real dgfemi_join_u(const dgfemi_joiner *joiner, int vertex) {
    return dgfemi_axis(joiner->mesh->vertices[vertex], joiner->axis_u);
}

static dgfem_real dgfemi_join_v(const dgfemi_joiner *joiner, int vertex) {
    return dgfemi_axis(joiner->mesh->vertices[vertex], joiner->axis_v);
}

/* Grows from 0 to 4 with the clockwise angle from the direction vertex -> back to the direction vertex -> to; no turn
   at all counts as 360 degrees. */
static dgfem_real dgfemi_join_turn(const dgfemi_joiner *joiner, int back, int vertex, int to) {
    dgfem_real u = dgfemi_join_u(joiner, vertex), v = dgfemi_join_v(joiner, vertex);
    dgfem_real back_u = dgfemi_join_u(joiner, back) - u, back_v = dgfemi_join_v(joiner, back) - v;
    dgfem_real to_u = dgfemi_join_u(joiner, to) - u, to_v = dgfemi_join_v(joiner, to) - v;
    dgfem_real cosine = back_u * to_u + back_v * to_v, sine = to_u * back_v - to_v * back_u;
    dgfem_real sum = dgfemi_abs(cosine) + dgfemi_abs(sine);
    if (!(sum > 0)) return 4;
    cosine /= sum;
    if (sine > 0 || (!(sine < 0) && cosine < 0)) return 1 - cosine;
    return sine < 0 ? 3 + cosine : 4;
}

/* Unlinks a segment from -> to, if there is one, and returns it. */
static int dgfemi_join_unlink(dgfemi_joiner *joiner, dgfemi_segments *segments, int from, int to) {
    dgfemi_segment_head *head = &joiner->heads[from];
    int *link, found;
    if (head->generation != joiner->generation) return DGFEM_NONE;
    for (link = &head->first; *link != DGFEM_NONE; link = &segments->data[*link].next)
        if (segments->data[*link].to == to) break;
    found = *link;
    if (found != DGFEM_NONE) *link = segments->data[found].next;
    return found;
}

/* Lists every segment with the vertex that it leaves. Two opposite ones cancel: both get `from` DGFEM_NONE. 1 on
   success, 0 when out of memory. */
static int dgfemi_join_link(dgfemi_joiner *joiner, dgfemi_segments *segments) {
    void *heads = joiner->heads;
    int i;
    if (!dgfemi_fit_zero(&joiner->mesh->hooks, &heads, &joiner->heads_capacity, joiner->mesh->vertex_count,
                         sizeof(dgfemi_segment_head)))
        return 0;
    joiner->heads = (dgfemi_segment_head *)heads;
    if (++joiner->generation == 0) {
        memset(joiner->heads, 0, (size_t)joiner->heads_capacity * sizeof(dgfemi_segment_head));
        joiner->generation = 1;
    }
    for (i = 0; i < segments->count; i++) {
        dgfemi_segment *segment = &segments->data[i];
        dgfemi_segment_head *head = &joiner->heads[segment->from];
        int opposite = dgfemi_join_unlink(joiner, segments, segment->to, segment->from);
        if (opposite != DGFEM_NONE) {
            segment->from = segments->data[opposite].from = DGFEM_NONE;
            continue;
        }
        if (head->generation != joiner->generation) {
            head->generation = joiner->generation;
            head->first = DGFEM_NONE;
        }
        segment->next = head->first;
        head->first = i;
    }
    return 1;
}

/* Takes the segment that goes on where the given one ends; DGFEM_NONE when there is none. Where several do, the first
   one clockwise from the way back: it bounds the same corner of the area, which is to the left.

            :  \     /
            area \ /  area       in from the upper right, on to the lower right
                 / \
               /     \                                                                            */
static int dgfemi_join_follow(dgfemi_joiner *joiner, dgfemi_segments *segments, int segment) {
    int back = segments->data[segment].from, vertex = segments->data[segment].to, taken;
    dgfemi_segment_head *head = &joiner->heads[vertex];
    int *link, *best = &head->first;
    dgfem_real best_turn = 5;
    if (head->generation != joiner->generation || head->first == DGFEM_NONE) return DGFEM_NONE;
    if (segments->data[head->first].next != DGFEM_NONE)
        for (link = &head->first; *link != DGFEM_NONE; link = &segments->data[*link].next) {
            dgfem_real turn = dgfemi_join_turn(joiner, back, vertex, segments->data[*link].to);
            if (turn < best_turn) best_turn = turn, best = link;
        }
    taken = *best;
    *best = segments->data[taken].next;
    segments->data[taken].next = DGFEM_SEGMENT_USED;
    return taken;
}

/* Fills joiner->start, joiner->vertices. */
static dgfem_status dgfemi_join_loops(dgfemi_joiner *joiner, dgfemi_segments *segments) {
    const dgfem_hooks *hooks = &joiner->mesh->hooks;
    int first, i, end;
    joiner->start.count = joiner->vertices.count = 0;
    if (!dgfemi_join_link(joiner, segments) || !dgfemi_push(hooks, &joiner->start, 0)) return DGFEM_ERROR_MEMORY;
    for (first = 0; first < segments->count; first++) {
        if (segments->data[first].from == DGFEM_NONE || segments->data[first].next == DGFEM_SEGMENT_USED) continue;
        i = first;
        do {
            if (!dgfemi_push(hooks, &joiner->vertices, segments->data[i].from)) return DGFEM_ERROR_MEMORY;
            end = segments->data[i].to;
            i = dgfemi_join_follow(joiner, segments, i);
            if (i == DGFEM_NONE)
                return dgfemi_fail(hooks, DGFEM_ERROR_INVARIANT, "the cut does not close at vertex %d", end);
        } while (i != first);
        if (!dgfemi_push(hooks, &joiner->start, joiner->vertices.count)) return DGFEM_ERROR_MEMORY;
    }
    return DGFEM_OK;
}

/* ---- regions ---- */

static int dgfemi_join_loop_count(const dgfemi_joiner *joiner) { return joiner->start.count - 1; }

/* Twice the area of a loop in the coordinates u, v; *noise: what round-off may have done to it. */
static dgfem_real dgfemi_join_area(const dgfemi_joiner *joiner, int loop, dgfem_real *noise) {
    const int *vertices = joiner->vertices.data + joiner->start.data[loop];
    int count = joiner->start.data[loop + 1] - joiner->start.data[loop], i;
    dgfem_real u = dgfemi_join_u(joiner, vertices[0]), v = dgfemi_join_v(joiner, vertices[0]);
    dgfem_real size = dgfemi_max(dgfemi_abs(u), dgfemi_abs(v)), length = 0, sum = 0, au = 0, av = 0;
    for (i = 1; i < count; i++) {
        dgfem_real bu = dgfemi_join_u(joiner, vertices[i]) - u, bv = dgfemi_join_v(joiner, vertices[i]) - v;
        sum += au * bv - av * bu;
        length += dgfemi_abs(bu - au) + dgfemi_abs(bv - av);
        au = bu, av = bv;
    }
    *noise = 16 * DGFEM_EPSILON * (size + length) * length;
    return sum;
}

/* Whether edge a -> b crosses the ray from (u, v) towards smaller u; where, and whether downwards. Loops may touch:
   round-off does not hide an edge. */
static int dgfemi_join_cross(const dgfemi_joiner *joiner, int a, int b, dgfem_real u, dgfem_real v, dgfem_real *at,
                             int *down) {
    dgfem_real va = dgfemi_join_v(joiner, a), vb = dgfemi_join_v(joiner, b);
    dgfem_real ua = dgfemi_join_u(joiner, a), ub = dgfemi_join_u(joiner, b);
    if ((va > v) == (vb > v)) return 0;
    *down = va > v;
    *at = ua + (v - va) / (vb - va) * (ub - ua);
    return *at <= u + 16 * DGFEM_EPSILON * (dgfemi_abs(ua) + dgfemi_abs(ub) + dgfemi_abs(va) + dgfemi_abs(vb));
}

/* The loop that a ray from this loop's vertex of smallest u towards smaller u meets first. An edge that bounds the
   region there has it on the side of larger u and so runs down, towards smaller v. For a loop that is known to be a hole
   only such edges count; any other loop is a hole if the first edge of all is such a one. DGFEM_NONE: no hole.

          |   region    +---+
          v  <----------+   |  hole
          |             +---+                                                                     */
static int dgfemi_join_hole_neighbour(const dgfemi_joiner *joiner, int hole, int known) {
    const int *vertices = joiner->vertices.data, *start = joiner->start.data;
    int extreme = vertices[start[hole]], nearest = DGFEM_NONE, nearest_down = 0, loop, i, down;
    dgfem_real u, v, at, best = 0;
    for (i = start[hole]; i < start[hole + 1]; i++)
        if (dgfemi_join_u(joiner, vertices[i]) < dgfemi_join_u(joiner, extreme)) extreme = vertices[i];
    u = dgfemi_join_u(joiner, extreme), v = dgfemi_join_v(joiner, extreme);
    for (loop = 0; loop < dgfemi_join_loop_count(joiner); loop++) {
        int a, b = vertices[start[loop + 1] - 1];
        if (loop == hole) continue;
        for (i = start[loop]; i < start[loop + 1]; i++) {
            a = b, b = vertices[i];
            if (!dgfemi_join_cross(joiner, a, b, u, v, &at, &down) || (known && !down)) continue;
            if (nearest == DGFEM_NONE || at > best) nearest = loop, nearest_down = down, best = at;
        }
    }
    return nearest_down ? nearest : DGFEM_NONE;
}

/* Fills joiner->owner: a loop that runs counter-clockwise owns itself, a hole belongs to its neighbour's owner. A loop
   without area is a slit or a speck, by its surroundings. A hole without neighbour, which takes round-off or a surface
   that crosses itself, becomes a region of its own. */
static dgfem_status dgfemi_join_regions(dgfemi_joiner *joiner) {
    int count = dgfemi_join_loop_count(joiner), loop, steps, *owner;
    joiner->owner.count = 0;
    for (loop = 0; loop < count; loop++)
        if (!dgfemi_push(&joiner->mesh->hooks, &joiner->owner, loop)) return DGFEM_ERROR_MEMORY;
    if (count < 2) return DGFEM_OK;
    owner = joiner->owner.data;
    for (loop = 0; loop < count; loop++) {
        dgfem_real noise, area = dgfemi_join_area(joiner, loop, &noise);
        if (area > noise) continue;
        owner[loop] = dgfemi_join_hole_neighbour(joiner, loop, area < -noise);
        if (owner[loop] == DGFEM_NONE) owner[loop] = loop;
    }
    for (loop = 0; loop < count; loop++) {
        int root = loop;
        for (steps = 0; owner[root] != root && steps < count; steps++) root = owner[root];
        owner[loop] = owner[root] == root ? root : loop; /* no cycles */
    }
    return DGFEM_OK;
}

/* ==== split_face.c ================================================================================================ */

/* Plane split, first half: the splitter, crossing vertices, cutting a face. split.c tells how all of it works. */

/* A vertex on the cut line of a face, and where along it. */
typedef struct dgfemi_crossing {
    dgfem_real t;
    int vertex;
} dgfemi_crossing;

typedef struct dgfemi_crossings {
    dgfemi_crossing *data;
    int count, capacity;
} dgfemi_crossings;

/* What became of a face that was cut: its parts are the faces first <= f < first + below + above. Where the part below
   is one with a single edge in the plane, that edge is p -> q; else p is DGFEM_NONE. */
typedef struct dgfemi_cut_face {
    unsigned generation;
    int first, below, above;
    int p, q;
} dgfemi_cut_face;

/* An element to come. */
typedef struct dgfemi_split_child {
    int parent;
    int side;                   /* -1 below, +1 above; 0: no child but the parent, outside the split, with new faces */
    int face_start, face_count; /* range of splitter.child_faces */
    int cap_start, cap_end;     /* the mesh's faces that are the parent's caps */
    int element;                /* index, once committed */
} dgfemi_split_child;

/* A face outside the split that gets new loops because its edges were split. */
typedef struct dgfemi_split_reloop {
    int face, loop_start;
} dgfemi_split_reloop;

/* Planes that new vertices are to lie on exactly when they are within `noise` of them: the grid of the slicer. */
typedef struct dgfemi_lattice {
    dgfem_real lower[3], cell[3];
    int cells[3];
    dgfem_real noise;
} dgfemi_lattice;

/* One splitter serves many planes: what it allocates is kept. */
typedef struct dgfemi_splitter {
    dgfem_mesh *mesh;

    /* options */
    dgfem_real snap;               /* as in dgfem_mesh_split_plane; not for axis planes */
    int components;                /* 1: every component of a part becomes an element of its own */
    int all;                       /* 1: all elements that straddle the plane are given, so that none outside shares an
                                      edge that is split */
    int measure;                   /* 1: new faces and elements are measured */
    const dgfemi_lattice *lattice; /* or NULL */

    /* the plane */
    dgfem_vec3 normal;    /* unit */
    int axis;             /* 0..2: the plane is a coordinate plane; DGFEM_NONE: any plane */
    dgfem_real *height;   /* [vertex_count] axis: the coordinate; any plane: distance times the length of its normal */
    dgfem_real low, high; /* vertices below have height < low, vertices above height > high; equal for an axis */
    dgfem_plane plane;    /* not for an axis */
    int snapped;          /* 1: some vertex counts as on the plane that is off it by more than round-off */
    signed char *snap_mark; /* [vertex_count] 1: to be snapped; -1: must not be */
    dgfem_real *extent;   /* [2 * face_count] axis: the face's lowest and highest coordinate; not known when reversed */
    int height_capacity, snap_mark_capacity, extent_capacity, extent_count;
    dgfemi_ints selected; /* elements that straddle the plane */

    /* one call */
    int vertex_count, face_count, loop_count, loop_vertex_count; /* of the mesh at its start */
    unsigned generation;                                         /* of valid marks */
    dgfemi_edge_map crossings;                                   /* edge -> crossing vertex */
    dgfemi_cut_face *cut;                                        /* [face_count] */
    unsigned *element_mark;                                      /* [element_count] given or renewed */
    int cut_capacity, element_mark_capacity;
    dgfemi_ints cut_faces;
    int failed_element;                                          /* on failure: the last one tried */
    dgfemi_split_child *children;
    dgfemi_ints child_faces;                                     /* codes */
    dgfemi_split_reloop *reloops;
    int child_count, child_capacity, reloop_count, reloop_capacity;

    /* one element: codes as in parts.c */
    dgfemi_ints below, above;
    dgfemi_ints touching;   /* those below that may have unknown edges in the plane */
    dgfemi_segments caps;   /* known edges of the caps */
    int coplanar;           /* 1: some face has all its vertices on the plane */
    dgfemi_parts parts;

    /* one face */
    dgfemi_segments pieces, lines;
    dgfemi_crossings ups, downs, ons;
    int along_axis, along_back;
    dgfemi_ints scratch_a, scratch_b;
    dgfemi_joiner joiner;
} dgfemi_splitter;

static void dgfemi_splitter_attach(dgfemi_splitter *s, dgfem_mesh *mesh) {
    s->mesh = mesh;
    s->parts.mesh = mesh;
    s->joiner.mesh = mesh;
}

static dgfemi_splitter dgfemi_splitter_make(dgfem_mesh *mesh) {
    dgfemi_splitter s;
    memset(&s, 0, sizeof s);
    s.axis = DGFEM_NONE;
    dgfemi_splitter_attach(&s, mesh);
    return s;
}

static void dgfemi_splitter_free(dgfemi_splitter *s) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    dgfemi_free(hooks, s->height);
    dgfemi_free(hooks, s->snap_mark);
    dgfemi_free(hooks, s->extent);
    dgfemi_free(hooks, s->selected.data);
    dgfemi_free(hooks, s->crossings.slots);
    dgfemi_free(hooks, s->cut);
    dgfemi_free(hooks, s->element_mark);
    dgfemi_free(hooks, s->cut_faces.data);
    dgfemi_free(hooks, s->children);
    dgfemi_free(hooks, s->child_faces.data);
    dgfemi_free(hooks, s->reloops);
    dgfemi_free(hooks, s->below.data);
    dgfemi_free(hooks, s->above.data);
    dgfemi_free(hooks, s->touching.data);
    dgfemi_free(hooks, s->caps.data);
    dgfemi_free(hooks, s->pieces.data);
    dgfemi_free(hooks, s->lines.data);
    dgfemi_free(hooks, s->ups.data);
    dgfemi_free(hooks, s->downs.data);
    dgfemi_free(hooks, s->ons.data);
    dgfemi_free(hooks, s->scratch_a.data);
    dgfemi_free(hooks, s->scratch_b.data);
    dgfemi_parts_free(&s->parts);
    dgfemi_joiner_free(&s->joiner);
}

/* Room for so many more items. 1 on success, 0 when out of memory. */
static int dgfemi_split_room(const dgfem_hooks *hooks, dgfemi_ints *ints, int extra) {
    void *data = ints->data;
    int ok = dgfemi_mesh_room(hooks, &data, ints->count, &ints->capacity, extra, sizeof(int));
    ints->data = (int *)data;
    return ok;
}

static int dgfemi_crossing_push(const dgfem_hooks *hooks, dgfemi_crossings *crossings, dgfem_real t, int vertex) {
    if (crossings->count == crossings->capacity) {
        void *grown = dgfemi_grow(hooks, crossings->data, &crossings->capacity, crossings->count + 1,
                                  sizeof(dgfemi_crossing));
        if (!grown) return 0;
        crossings->data = (dgfemi_crossing *)grown;
    }
    crossings->data[crossings->count].t = t;
    crossings->data[crossings->count++].vertex = vertex;
    return 1;
}

/* ---- vertices ---- */

/* -1 below, 0 on, +1 above the plane. */
static int dgfemi_split_sign(const dgfemi_splitter *s, int vertex) {
    dgfem_real height = s->height[vertex];
    return (height > s->high) - (height < s->low);
}

/* Appends a vertex that is on the plane; DGFEM_NONE when out of memory. */
static int dgfemi_split_add_vertex(dgfemi_splitter *s, dgfem_vec3 p) {
    int vertex = dgfemi_mesh_add_vertex(s->mesh, p);
    if (vertex == DGFEM_NONE) return DGFEM_NONE;
    if (vertex >= s->height_capacity) {
        void *grown = dgfemi_grow(&s->mesh->hooks, s->height, &s->height_capacity, vertex + 1, sizeof(dgfem_real));
        if (!grown) return DGFEM_NONE;
        s->height = (dgfem_real *)grown;
    }
    s->height[vertex] = s->axis == DGFEM_NONE ? 0 : s->low;
    return vertex;
}

static dgfem_real *dgfemi_axis_of(dgfem_vec3 *p, int axis) { return axis == 0 ? &p->x : axis == 1 ? &p->y : &p->z; }

static dgfem_real dgfemi_lattice_plane(const dgfemi_lattice *lattice, int axis, int index) {
    return lattice->lower[axis] + (dgfem_real)index * lattice->cell[axis];
}

/* Moves the coordinates that only round-off keeps off an inner plane of the lattice onto it. */
static void dgfemi_lattice_snap(const dgfemi_lattice *lattice, dgfem_vec3 *p) {
    int axis;
    for (axis = 0; axis < 3; axis++) {
        dgfem_real *x = dgfemi_axis_of(p, axis);
        dgfem_real index = (*x - lattice->lower[axis]) / lattice->cell[axis] + DGFEM_R(0.5);
        if (index >= 1 && index < (dgfem_real)lattice->cells[axis]) {
            dgfem_real plane = dgfemi_lattice_plane(lattice, axis, (int)index);
            if (dgfemi_abs(*x - plane) <= lattice->noise) *x = plane;
        }
    }
}

/* Where the edge from a to b meets the plane; never outside the edge's box. */
static dgfem_vec3 dgfemi_split_interpolate(const dgfemi_splitter *s, int a, int b) {
    dgfem_vec3 pa = s->mesh->vertices[a], pb = s->mesh->vertices[b], p;
    dgfem_real height = s->axis == DGFEM_NONE ? 0 : s->low;
    p = dgfemi_add_scaled(pa, (height - s->height[a]) / (s->height[b] - s->height[a]), dgfemi_sub(pb, pa));
    return dgfemi_max3(dgfemi_min3(p, dgfemi_max3(pa, pb)), dgfemi_min3(pa, pb));
}

/* The vertex where the plane crosses an edge from below to above or back; DGFEM_NONE when out of memory. */
static int dgfemi_split_crossing(dgfemi_splitter *s, int a, int b) {
    dgfemi_edge_slot *slot = dgfemi_edge_map_at(&s->crossings, a, b);
    dgfem_vec3 p;
    int vertex;
    if (dgfemi_edge_map_has(&s->crossings, slot)) return slot->value;
    p = a < b ? dgfemi_split_interpolate(s, a, b) : dgfemi_split_interpolate(s, b, a);
    if (s->axis != DGFEM_NONE) *dgfemi_axis_of(&p, s->axis) = s->low;
    if (s->lattice) dgfemi_lattice_snap(s->lattice, &p);
    vertex = dgfemi_split_add_vertex(s, p);
    if (vertex == DGFEM_NONE) return DGFEM_NONE;
    return dgfemi_edge_map_set(&s->mesh->hooks, &s->crossings, slot, a, b, vertex) ? vertex : DGFEM_NONE;
}

/* ---- new faces from segments ---- */

/* Appends a face of the last loops; all but its normal it inherits from `like`. 1 on success, 0 when out of memory. */
static int dgfemi_split_add_face(dgfem_mesh *mesh, const dgfem_face *like, int loops, dgfem_vec3 normal) {
    int face = dgfemi_mesh_add_face(mesh, mesh->loop_count - loops, loops, like->element[0], like->element[1],
                                    like->tag, normal);
    if (face != DGFEM_NONE) mesh->faces[face].cut = like->cut;
    return face != DGFEM_NONE;
}

/* 1 when the last loops have a vertex that was snapped. */
static int dgfemi_split_is_bent(const dgfemi_splitter *s, int loops) {
    const dgfem_mesh *mesh = s->mesh;
    int i;
    if (!s->snapped) return 0;
    for (i = mesh->loops[mesh->loop_count - loops].start; i < mesh->loop_vertex_count; i++) {
        int v = mesh->loop_vertices[i];
        dgfem_real distance = dgfemi_dot(s->plane.normal, mesh->vertices[v]) - s->plane.offset;
        if (v < s->vertex_count && dgfemi_abs(distance) > s->high) return 1;
    }
    return 0;
}

/* The middle of a region that snapping has bent, moved onto the plane. */
static dgfem_vec3 dgfemi_split_bent_centre(const dgfemi_splitter *s, const int *loop, int count) {
    const dgfem_vec3 *vertices = s->mesh->vertices;
    dgfem_vec3 origin = vertices[loop[0]], moment = dgfemi_vec3(0, 0, 0), centre, n = s->plane.normal;
    dgfem_real twice = 0;
    int i;
    for (i = 2; i < count; i++) {
        dgfem_vec3 a = dgfemi_sub(vertices[loop[i - 1]], origin), b = dgfemi_sub(vertices[loop[i]], origin);
        dgfem_real area = dgfemi_dot(s->normal, dgfemi_cross(a, b));
        twice += area;
        moment = dgfemi_add_scaled(moment, area, dgfemi_add(a, b));
    }
    centre = dgfemi_add_scaled(origin, 1 / (3 * twice), moment);
    return dgfemi_add_scaled(centre, (s->plane.offset - dgfemi_dot(n, centre)) / dgfemi_dot(n, n), n);
}

/* A triangle of a bent region must have this fraction of the area that it would have if all were alike, */
#define DGFEM_BENT_AREA DGFEM_R(1e-3)
/* and this cosine to the plane's normal: snapping is to change the plane a little. */
#define DGFEM_BENT_COSINE DGFEM_R(0.8)

/* A region that snapping has bent becomes triangles around its middle, each in its own plane: exact integrals need
   planar faces. Refuses holes and regions whose middle does not see all of their boundary well. */
static dgfem_status dgfemi_split_add_bent(dgfemi_splitter *s, const dgfem_face *like, int loops) {
    dgfem_mesh *mesh = s->mesh;
    int count = mesh->loops[mesh->loop_count - 1].count, start = mesh->loops[mesh->loop_count - 1].start, centre, i;
    dgfem_real whole;
    if (loops > 1) return DGFEM_ERROR_DEGENERATE;
    s->scratch_a.count = 0;
    for (i = 0; i < count; i++)
        if (!dgfemi_push(&mesh->hooks, &s->scratch_a, mesh->loop_vertices[start + i])) return DGFEM_ERROR_MEMORY;
    mesh->loop_count--, mesh->loop_vertex_count = start;
    centre = dgfemi_split_add_vertex(s, dgfemi_split_bent_centre(s, s->scratch_a.data, count));
    if (centre == DGFEM_NONE) return DGFEM_ERROR_MEMORY;
    for (i = 0, whole = 0; i < 2 * count; i++) { /* the areas, then the faces */
        int triangle[3];
        dgfem_vec3 p = mesh->vertices[centre], a, b, area;
        dgfem_real flat;
        triangle[0] = centre, triangle[1] = s->scratch_a.data[i % count], triangle[2] = s->scratch_a.data[(i + 1) % count];
        a = dgfemi_sub(mesh->vertices[triangle[1]], p), b = dgfemi_sub(mesh->vertices[triangle[2]], p);
        area = dgfemi_cross(a, b), flat = dgfemi_dot(area, s->normal);
        if (i < count) {
            whole += flat;
            continue;
        }
        if (!(flat > DGFEM_BENT_AREA * whole / (dgfem_real)count) || !(flat > DGFEM_BENT_COSINE * dgfemi_norm(area)))
            return DGFEM_ERROR_DEGENERATE;
        if (dgfemi_mesh_add_loop(mesh, triangle, 3) == DGFEM_NONE ||
            !dgfemi_split_add_face(mesh, like, 1, dgfemi_normalized(area)))
            return DGFEM_ERROR_MEMORY;
    }
    return DGFEM_OK;
}

/* One face for the region of the joined loop `outer`. */
static dgfem_status dgfemi_split_add_region(dgfemi_splitter *s, const dgfem_face *like, int outer) {
    const dgfemi_joiner *joiner = &s->joiner;
    int is_cap = like->element[0] == like->element[1], loops = 0, loop;
    for (loop = 0; loop < dgfemi_join_loop_count(joiner); loop++) {
        int start = joiner->start.data[loop], count = joiner->start.data[loop + 1] - start;
        if (joiner->owner.data[loop] != outer) continue;
        if (dgfemi_mesh_add_loop(s->mesh, joiner->vertices.data + start, count) == DGFEM_NONE) return DGFEM_ERROR_MEMORY;
        loops++;
    }
    if (is_cap && dgfemi_split_is_bent(s, loops)) return dgfemi_split_add_bent(s, like, loops);
    return dgfemi_split_add_face(s->mesh, like, loops, like->normal) ? DGFEM_OK : DGFEM_ERROR_MEMORY;
}

/* Joins the segments into faces that inherit from `like`. *first, *count: the new ones. */
static dgfem_status dgfemi_split_add_faces(dgfemi_splitter *s, dgfemi_segments *segments, const dgfem_face *like,
                                           int *first, int *count) {
    dgfem_status status;
    int loop;
    *first = s->mesh->face_count;
    dgfemi_projection_axes(like->normal, &s->joiner.axis_u, &s->joiner.axis_v);
    status = dgfemi_join_loops(&s->joiner, segments);
    if (!status) status = dgfemi_join_regions(&s->joiner);
    for (loop = 0; !status && loop < dgfemi_join_loop_count(&s->joiner); loop++)
        if (s->joiner.owner.data[loop] == loop) status = dgfemi_split_add_region(s, like, loop);
    *count = s->mesh->face_count - *first;
    return status;
}

/* ---- cutting a face ---- */

typedef struct dgfemi_face_signs {
    int below, on, above; /* numbers of vertices, or 1 for any */
    int simple;           /* one loop that passes the plane once up and once down, with no other vertex on it */
} dgfemi_face_signs;

static dgfemi_face_signs dgfemi_split_count_signs(const dgfemi_splitter *s, const dgfem_face *face) {
    const dgfem_mesh *mesh = s->mesh;
    dgfemi_face_signs signs = {0, 0, 0, 0};
    int l, i, ups = 0, touches = 0;
    for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        int count = mesh->loops[l].count, last = dgfemi_split_sign(s, loop[count - 1]);
        for (i = 0; i < count; i++) {
            int sign = dgfemi_split_sign(s, loop[i]);
            signs.below += sign < 0;
            signs.above += sign > 0;
            if (sign == 0) {
                signs.on++;
                touches |= last * dgfemi_split_sign(s, loop[i + 1 < count ? i + 1 : 0]) != -1;
            }
            ups += last < 0 && sign >= 0;
            last = sign;
        }
    }
    signs.simple = face->loop_count == 1 && ups == 1 && !touches;
    return signs;
}

static void dgfemi_split_measure_extent(dgfemi_splitter *s, int f) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_face *face = &mesh->faces[f];
    dgfem_real low = s->height[mesh->loop_vertices[mesh->loops[face->loop_start].start]], high = low;
    int l, i;
    for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        for (i = 0; i < mesh->loops[l].count; i++) {
            low = dgfemi_min(low, s->height[loop[i]]);
            high = dgfemi_max(high, s->height[loop[i]]);
        }
    }
    s->extent[2 * f] = low, s->extent[2 * f + 1] = high;
}

/* Where many axis planes follow each other, most faces are told by their extents. */
static dgfemi_face_signs dgfemi_split_face_signs(dgfemi_splitter *s, int f) {
    dgfemi_face_signs below = {1, 0, 0, 0}, above = {0, 0, 1, 0};
    if (s->axis != DGFEM_NONE) {
        if (s->extent[2 * f] > s->extent[2 * f + 1]) dgfemi_split_measure_extent(s, f);
        if (s->extent[2 * f + 1] < s->low) return below;
        if (s->extent[2 * f] > s->high) return above;
    }
    return dgfemi_split_count_signs(s, &s->mesh->faces[f]);
}

static int dgfemi_split_add_piece(dgfem_mesh *mesh, const dgfem_face *like, const dgfemi_ints *loop) {
    return dgfemi_mesh_add_loop(mesh, loop->data, loop->count) != DGFEM_NONE &&
           dgfemi_split_add_face(mesh, like, 1, like->normal);
}

/* Fills s->scratch_a with the vertices below, s->scratch_b with those above, both in the order of the loop; *p, *q:
   where it goes up and down. 1 on success, 0 when out of memory. */
static int dgfemi_split_part_loop(dgfemi_splitter *s, dgfem_loop loop, int *p, int *q) {
    const dgfem_mesh *mesh = s->mesh;
    int first = 0, i, last, last_sign;
    s->scratch_a.count = s->scratch_b.count = 0;
    if (!dgfemi_split_room(&mesh->hooks, &s->scratch_a, loop.count + 2) ||
        !dgfemi_split_room(&mesh->hooks, &s->scratch_b, loop.count + 2))
        return 0;
    while (dgfemi_split_sign(s, mesh->loop_vertices[loop.start + first]) < 0) first++;
    while (dgfemi_split_sign(s, mesh->loop_vertices[loop.start + first]) >= 0) first = (first + 1) % loop.count;
    last = mesh->loop_vertices[loop.start + (first + loop.count - 1) % loop.count]; /* the last one not below */
    last_sign = dgfemi_split_sign(s, last);
    *q = last;
    for (i = 0; i < loop.count; i++) {
        int vertex = mesh->loop_vertices[loop.start + (first + i) % loop.count], sign = dgfemi_split_sign(s, vertex);
        if (last_sign * sign < 0) {
            int crossing = dgfemi_split_crossing(s, last, vertex);
            if (crossing == DGFEM_NONE) return 0;
            *(sign < 0 ? q : p) = crossing;
        } else if (last_sign < 0 && sign == 0) {
            *p = vertex;
        }
        if (sign < 0) s->scratch_a.data[s->scratch_a.count++] = vertex;
        if (sign > 0) s->scratch_b.data[s->scratch_b.count++] = vertex;
        last = vertex, last_sign = sign;
    }
    return 1;
}

/* 1 when the element has an edge between two vertices. */
static int dgfemi_split_has_edge(const dgfemi_splitter *s, int element, int a, int b) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_element *e = &mesh->elements[element];
    int k, l, i;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
            const int *loop = mesh->loop_vertices + mesh->loops[l].start;
            int count = mesh->loops[l].count;
            for (i = 0; i < count; i++) {
                int from = loop[i], to = loop[i + 1 < count ? i + 1 : 0];
                if ((from == a && to == b) || (from == b && to == a)) return 1;
            }
        }
    }
    return 0;
}

/* 1 when some other edge joins two vertices of a face already. That takes faces which touch along it; a cut line must
   not be taken for that edge. */
static int dgfemi_split_is_taken(const dgfemi_splitter *s, const dgfem_face *face, int from, int to) {
    if (from >= s->vertex_count || to >= s->vertex_count) return 0;
    return dgfemi_split_has_edge(s, face->element[0], from, to) ||
           (face->element[1] != DGFEM_NONE && dgfemi_split_has_edge(s, face->element[1], from, to));
}

/* A face with simple signs. Leaves cut->below at 0 where it is not so simple after all. */
static dgfem_status dgfemi_split_cut_simple(dgfemi_splitter *s, const dgfem_face *face, dgfemi_cut_face *cut) {
    dgfem_mesh *mesh = s->mesh;
    if (!dgfemi_split_part_loop(s, mesh->loops[face->loop_start], &cut->p, &cut->q)) return DGFEM_ERROR_MEMORY;
    if (cut->p == cut->q || dgfemi_split_is_taken(s, face, cut->p, cut->q)) return DGFEM_OK;
    s->scratch_a.data[s->scratch_a.count++] = cut->p;
    s->scratch_a.data[s->scratch_a.count++] = cut->q;
    s->scratch_b.data[s->scratch_b.count++] = cut->q;
    s->scratch_b.data[s->scratch_b.count++] = cut->p;
    cut->first = mesh->face_count;
    cut->below = cut->above = 1;
    if (!dgfemi_split_add_piece(mesh, face, &s->scratch_a) || !dgfemi_split_add_piece(mesh, face, &s->scratch_b))
        return DGFEM_ERROR_MEMORY;
    return DGFEM_OK;
}

static int dgfemi_crossing_compare(const void *a, const void *b) {
    const dgfemi_crossing *x = (const dgfemi_crossing *)a, *y = (const dgfemi_crossing *)b;
    if (x->t < y->t) return -1;
    if (x->t > y->t) return 1;
    return (x->vertex > y->vertex) - (x->vertex < y->vertex);
}

static void dgfemi_crossings_sort(dgfemi_crossings *crossings) {
    if (crossings->count > 1)
        qsort(crossings->data, (size_t)crossings->count, sizeof(dgfemi_crossing), dgfemi_crossing_compare);
}

/* Where a vertex is along the cut line of the face at hand, in the direction in which that line closes the part below.
   As a coordinate: nothing is rounded. */
static dgfem_real dgfemi_split_along(const dgfemi_splitter *s, int vertex) {
    dgfem_real t = dgfemi_axis(s->mesh->vertices[vertex], s->along_axis);
    return s->along_back ? -t : t;
}

static void dgfemi_split_set_along(dgfemi_splitter *s, dgfem_vec3 face_normal) {
    dgfem_vec3 along = dgfemi_cross(face_normal, s->normal);
    dgfem_real x = dgfemi_abs(along.x), y = dgfemi_abs(along.y), z = dgfemi_abs(along.z);
    s->along_axis = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
    s->along_back = dgfemi_axis(along, s->along_axis) < 0;
}

/* On which side of the plane the face is at its edge a -> b, which does not cross the plane. An edge in the plane has
   the face on its left: below when it runs along the cut line. */
static int dgfemi_split_edge_side(const dgfemi_splitter *s, int a, int b) {
    int side = dgfemi_split_sign(s, a) + dgfemi_split_sign(s, b);
    return side != 0 ? side : dgfemi_split_along(s, b) > dgfemi_split_along(s, a) ? -1 : 1;
}

/* Lists what a vertex b contributes, between its neighbours a and c: where the loop passes to the other side, on edge
   a -> b or at b; and b as a vertex on the plane where the loop only touches it. */
static int dgfemi_split_list_vertex(dgfemi_splitter *s, int a, int b, int c) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    int sign_a = dgfemi_split_sign(s, a), sign_b = dgfemi_split_sign(s, b), from = sign_a;
    if (sign_b == 0) {
        from = dgfemi_split_edge_side(s, a, b);
        if ((from < 0) == (dgfemi_split_edge_side(s, b, c) < 0))
            return dgfemi_crossing_push(hooks, &s->ons, dgfemi_split_along(s, b), b);
    } else {
        if (sign_a * sign_b >= 0) return 1;
        b = dgfemi_split_crossing(s, a, b);
        if (b == DGFEM_NONE) return 0;
    }
    return dgfemi_crossing_push(hooks, from < 0 ? &s->ups : &s->downs, dgfemi_split_along(s, b), b);
}

/* Lists the crossings of a face, up and down, and the vertices that touch the plane, each sorted along the cut line. */
static dgfem_status dgfemi_split_list_crossings(dgfemi_splitter *s, const dgfem_face *face) {
    const dgfem_mesh *mesh = s->mesh;
    int l, i;
    s->ups.count = s->downs.count = s->ons.count = 0;
    dgfemi_split_set_along(s, face->normal);
    for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        int start = mesh->loops[l].start, count = mesh->loops[l].count;
        for (i = 0; i < count; i++)
            if (!dgfemi_split_list_vertex(s, mesh->loop_vertices[start + (i + count - 1) % count],
                                          mesh->loop_vertices[start + i], mesh->loop_vertices[start + (i + 1) % count]))
                return DGFEM_ERROR_MEMORY;
    }
    DGFEM_ASSERT(s->ups.count == s->downs.count);
    dgfemi_crossings_sort(&s->ups);
    dgfemi_crossings_sort(&s->downs);
    dgfemi_crossings_sort(&s->ons);
    return DGFEM_OK;
}

/* Adds a segment; where there is an edge like it, with a vertex in the middle. 1 on success, 0 when out of memory. */
static int dgfemi_split_push_line(dgfemi_splitter *s, const dgfem_face *face, int from, int to) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    int middle;
    if (!dgfemi_split_is_taken(s, face, from, to)) return dgfemi_segment_push(hooks, &s->lines, from, to);
    middle = dgfemi_split_add_vertex(s, dgfemi_scale(DGFEM_R(0.5), dgfemi_add(s->mesh->vertices[from],
                                                                             s->mesh->vertices[to])));
    return middle != DGFEM_NONE && dgfemi_segment_push(hooks, &s->lines, from, middle) &&
           dgfemi_segment_push(hooks, &s->lines, middle, to);
}

/* Fills s->lines with segments up -> down, broken at the vertices that touch them (one for each place):

         \      /
          \ w  /          w: the loop comes down from above to touch the line
       ----+-+-------                                                                                */
static dgfem_status dgfemi_split_list_lines(dgfemi_splitter *s, const dgfem_face *face) {
    int k, i, ons = s->ons.count;
    s->lines.count = 0;
    for (k = 0; k < s->ups.count; k++) {
        dgfemi_crossing last = s->ups.data[k], to = s->downs.data[k];
        int forward = last.t < to.t;
        for (i = 0; i < ons; i++) {
            dgfemi_crossing on = s->ons.data[forward ? i : ons - 1 - i];
            if (!(forward ? on.t > last.t && on.t < to.t : on.t < last.t && on.t > to.t)) continue;
            if (!dgfemi_split_push_line(s, face, last.vertex, on.vertex)) return DGFEM_ERROR_MEMORY;
            last = on;
        }
        if (last.vertex != to.vertex && !dgfemi_split_push_line(s, face, last.vertex, to.vertex))
            return DGFEM_ERROR_MEMORY;
    }
    return DGFEM_OK;
}

/* Adds to s->pieces what edge a -> b has on one side. 1 on success, 0 when out of memory. */
static int dgfemi_split_clip_edge(dgfemi_splitter *s, int a, int b, int side) {
    int sign_a = dgfemi_split_sign(s, a), sign_b = dgfemi_split_sign(s, b);
    if (sign_a * sign_b < 0) {
        int crossing = dgfemi_split_crossing(s, a, b); /* exists */
        if (sign_a == side) b = crossing;
        else a = crossing;
    } else if ((dgfemi_split_edge_side(s, a, b) < 0) != (side < 0)) {
        return 1;
    }
    return dgfemi_segment_push(&s->mesh->hooks, &s->pieces, a, b);
}

/* Fills s->pieces with the face's edges on one side, clipped, and the lines that close them. */
static dgfem_status dgfemi_split_list_pieces(dgfemi_splitter *s, const dgfem_face *face, int side) {
    const dgfem_mesh *mesh = s->mesh;
    int l, i;
    s->pieces.count = 0;
    for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        int start = mesh->loops[l].start, count = mesh->loops[l].count;
        for (i = 0; i < count; i++)
            if (!dgfemi_split_clip_edge(s, mesh->loop_vertices[start + i], mesh->loop_vertices[start + (i + 1) % count],
                                        side))
                return DGFEM_ERROR_MEMORY;
    }
    for (i = 0; i < s->lines.count; i++) {
        dgfemi_segment line = s->lines.data[i];
        if (!dgfemi_segment_push(&mesh->hooks, &s->pieces, side < 0 ? line.from : line.to,
                                 side < 0 ? line.to : line.from))
            return DGFEM_ERROR_MEMORY;
    }
    return DGFEM_OK;
}

/* Any number of loops and crossings. */
static dgfem_status dgfemi_split_cut_general(dgfemi_splitter *s, const dgfem_face *face, dgfemi_cut_face *cut) {
    dgfem_status status = dgfemi_split_list_crossings(s, face);
    int first_above;
    cut->p = cut->q = DGFEM_NONE;
    if (!status) status = dgfemi_split_list_lines(s, face);
    if (!status) status = dgfemi_split_list_pieces(s, face, -1);
    if (!status) status = dgfemi_split_add_faces(s, &s->pieces, face, &cut->first, &cut->below);
    if (!status) status = dgfemi_split_list_pieces(s, face, 1);
    if (!status) status = dgfemi_split_add_faces(s, &s->pieces, face, &first_above, &cut->above);
    return status;
}

/* Cuts a face that has vertices below and above; the second of its elements finds what the first one did. */
static dgfem_status dgfemi_split_cut_face(dgfemi_splitter *s, int f, int simple, dgfemi_cut_face *cut) {
    dgfem_face face = s->mesh->faces[f]; /* a copy: faces move */
    dgfem_status status = DGFEM_OK;
    if (s->cut[f].generation == s->generation) {
        *cut = s->cut[f];
        return DGFEM_OK;
    }
    memset(cut, 0, sizeof *cut);
    cut->generation = s->generation;
    if (simple) status = dgfemi_split_cut_simple(s, &face, cut);
    if (!status && cut->below == 0) status = dgfemi_split_cut_general(s, &face, cut);
    s->cut[f] = *cut;
    if (!status && !dgfemi_push(&s->mesh->hooks, &s->cut_faces, f)) status = DGFEM_ERROR_MEMORY;
    return status;
}

/* ==== split.c ===================================================================================================== */

/* Plane split of elements of the cell complex; the stand-alone polyhedron is split as a complex of one element.

   Logic and geometry are kept apart. Each vertex is below, on or above the plane, decided once, and all else follows
   from these signs by counting: the parts close whatever round-off does to positions.

   - "On" counts as above, but no part without thickness comes of it: an element is split when it has vertices below and
     above, and a face or an edge in the plane belongs to the side that the interior next to it is on.
   - A crossing vertex is made once per edge, interpolated from the edge's lower index, and found again by hash.
   - A face with vertices below and above is cut along segments between its crossings. Along the cut line, upward and
     downward crossings are as many as each other; the k-th of the ones is joined to the k-th of the others:

             d1        u1     d2       u2       counter-clockwise, d = down, u = up:
          ----+--------+------+--------+----    u1 -> d1, u2 -> d2 close the part below,
               \ below/        \ below/         the same ones reversed close the part above

   - The edges in the plane that the part below is left with close into loops, which bound the new faces (caps) between
     below and above. A cap of several loops is split into regions, so that islands stay separate.

   All this appends to the mesh; only the commit at the end, which cannot fail, changes what was there. */

/* ---- cutting an element ---- */

/* A face that is not cut goes where its vertices are; one in the plane, to the side of the element's interior. */
static dgfem_status dgfemi_split_sort_whole(dgfemi_splitter *s, int code, const dgfemi_face_signs *signs) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    int below = signs->below > 0, ok;
    if (signs->below == 0 && signs->above == 0) {
        dgfem_real up = dgfemi_dot(s->mesh->faces[code / 2].normal, s->normal);
        below = code % 2 ? up < 0 : up > 0;
        s->coplanar = 1;
    }
    ok = dgfemi_push(hooks, below ? &s->below : &s->above, code);
    if (ok && below && signs->on > 1) ok = dgfemi_push(hooks, &s->touching, code);
    return ok ? DGFEM_OK : DGFEM_ERROR_MEMORY;
}

static dgfem_status dgfemi_split_sort_cut(dgfemi_splitter *s, int code, const dgfemi_face_signs *signs) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    dgfemi_cut_face cut;
    dgfem_status status = dgfemi_split_cut_face(s, code / 2, signs->simple, &cut);
    int i, ok = 1, inwards = code % 2, known = cut.p != DGFEM_NONE;
    if (status) return status;
    for (i = 0; ok && i < cut.below; i++) {
        ok = dgfemi_push(hooks, &s->below, 2 * (cut.first + i) + inwards);
        if (ok && !known) ok = dgfemi_push(hooks, &s->touching, 2 * (cut.first + i) + inwards);
    }
    for (i = 0; ok && i < cut.above; i++)
        ok = dgfemi_push(hooks, &s->above, 2 * (cut.first + cut.below + i) + inwards);
    if (ok && known) ok = dgfemi_segment_push(hooks, &s->caps, inwards ? cut.p : cut.q, inwards ? cut.q : cut.p);
    return ok ? DGFEM_OK : DGFEM_ERROR_MEMORY;
}

/* Fills s->below, s->above, s->touching, s->caps. */
static dgfem_status dgfemi_split_sort_faces(dgfemi_splitter *s, int element) {
    const dgfem_mesh *mesh = s->mesh;
    dgfem_element e = mesh->elements[element];
    dgfem_status status = DGFEM_OK;
    int k;
    s->below.count = s->above.count = s->touching.count = s->caps.count = 0;
    s->coplanar = 0;
    for (k = e.face_start; !status && k < e.face_start + e.face_count; k++) {
        int f = mesh->element_faces[k], code = 2 * f + (mesh->faces[f].element[0] != element);
        dgfemi_face_signs signs = dgfemi_split_face_signs(s, f);
        if (signs.below > 0 && signs.above > 0) status = dgfemi_split_sort_cut(s, code, &signs);
        else status = dgfemi_split_sort_whole(s, code, &signs);
    }
    return status;
}

/* Adds to s->pieces the edges in the plane of a face below, as the caps have them: reversed. */
static int dgfemi_split_list_touching(dgfemi_splitter *s, int code) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_face *face = &mesh->faces[code / 2];
    int l, i;
    for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        int count = mesh->loops[l].count, a, b = loop[count - 1], on_a, on_b = dgfemi_split_sign(s, b) == 0;
        for (i = 0; i < count; i++) {
            a = b, on_a = on_b;
            b = loop[i], on_b = dgfemi_split_sign(s, b) == 0;
            if (on_a && on_b && !dgfemi_segment_push(&mesh->hooks, &s->pieces, code % 2 ? a : b, code % 2 ? b : a))
                return 0;
        }
    }
    return 1;
}

/* Closes both parts by caps, the faces *first <= f < *end. Until the commit they have the element on both sides. */
static dgfem_status dgfemi_split_add_caps(dgfemi_splitter *s, int element, int *first, int *end) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    dgfem_status status = DGFEM_OK;
    dgfem_face like;
    int i, count = 0;
    memset(&like, 0, sizeof like);
    like.element[0] = like.element[1] = element;
    like.tag = DGFEM_NONE;
    like.normal = s->normal;
    s->pieces.count = 0;
    for (i = 0; i < s->caps.count; i++)
        if (!dgfemi_segment_push(hooks, &s->pieces, s->caps.data[i].from, s->caps.data[i].to)) return DGFEM_ERROR_MEMORY;
    for (i = 0; i < s->touching.count; i++)
        if (!dgfemi_split_list_touching(s, s->touching.data[i])) return DGFEM_ERROR_MEMORY;
    *first = s->mesh->face_count;
    if (s->pieces.count > 0) status = dgfemi_split_add_faces(s, &s->pieces, &like, first, &count);
    *end = *first + count;
    for (i = *first; !status && i < *end; i++)
        if (!dgfemi_push(hooks, &s->below, 2 * i) || !dgfemi_push(hooks, &s->above, 2 * i + 1))
            status = DGFEM_ERROR_MEMORY;
    return status;
}

/* ---- parts without thickness ---- */

/* 1 when some vertex of the face is off the plane. */
static int dgfemi_split_has_depth(const dgfemi_splitter *s, int face) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_face *f = &mesh->faces[face];
    int l, i;
    for (l = f->loop_start; l < f->loop_start + f->loop_count; l++)
        for (i = 0; i < mesh->loops[l].count; i++)
            if (dgfemi_split_sign(s, mesh->loop_vertices[mesh->loops[l].start + i]) != 0) return 1;
    return 0;
}

static void dgfemi_split_remove(dgfemi_ints *codes, int code) {
    int i, kept = 0;
    for (i = 0; i < codes->count; i++)
        if (codes->data[i] != code) codes->data[kept++] = codes->data[i];
    codes->count = kept;
}

/* Moves the faces, all but caps, of components without thickness to the other side, and counts them. */
static dgfem_status dgfemi_split_move_flat(dgfemi_splitter *s, dgfemi_ints *from, dgfemi_ints *to, int first_cap,
                                           int *moved) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    int k, i;
    *moved = 0;
    if (!dgfemi_parts_find(&s->parts, from)) return DGFEM_ERROR_MEMORY;
    for (i = 0; i < s->parts.count; i++) s->parts.parent[i] = 0; /* from here on: has thickness */
    for (k = 0; k < from->count; k++)
        if (dgfemi_split_has_depth(s, from->data[k] / 2)) s->parts.parent[s->parts.component[k]] = 1;
    s->scratch_a.count = 0;
    for (k = 0; k < from->count; k++)
        if (!s->parts.parent[s->parts.component[k]] && from->data[k] / 2 < first_cap &&
            !dgfemi_push(hooks, &s->scratch_a, from->data[k]))
            return DGFEM_ERROR_MEMORY;
    for (i = 0; i < s->scratch_a.count; i++) {
        int code = s->scratch_a.data[i];
        dgfemi_split_remove(from, code);
        dgfemi_split_remove(&s->touching, code);
        if (!dgfemi_push(hooks, to, code) || (to == &s->below && !dgfemi_push(hooks, &s->touching, code)))
            return DGFEM_ERROR_MEMORY;
    }
    *moved = s->scratch_a.count;
    return DGFEM_OK;
}

/* Caps; where they leave a part without thickness, caps again without it. Such a part comes from faces that are in the
   plane but for round-off or snapping, and it is anyone's guess on which side they are. */
static dgfem_status dgfemi_split_close(dgfemi_splitter *s, int element, int *first_cap, int *end_cap) {
    dgfem_mesh *mesh = s->mesh;
    int attempt, moved, loops = mesh->loop_count, loop_vertices = mesh->loop_vertex_count;
    for (attempt = 0; attempt < 4; attempt++) {
        dgfem_status status = dgfemi_split_add_caps(s, element, first_cap, end_cap);
        if (status || !s->coplanar) return status;
        status = dgfemi_split_move_flat(s, &s->below, &s->above, *first_cap, &moved);
        if (!status && !moved) status = dgfemi_split_move_flat(s, &s->above, &s->below, *first_cap, &moved);
        if (status || !moved) return status;
        for (; *end_cap > *first_cap; --*end_cap) {
            dgfemi_split_remove(&s->below, 2 * (*end_cap - 1));
            dgfemi_split_remove(&s->above, 2 * (*end_cap - 1) + 1);
        }
        mesh->face_count = *first_cap, mesh->loop_count = loops, mesh->loop_vertex_count = loop_vertices;
    }
    return dgfemi_fail(&mesh->hooks, DGFEM_ERROR_DEGENERATE, "element %d: a part of it lies in the plane", element);
}

/* ---- children ---- */

/* Adds the faces of one component, or all for DGFEM_NONE, as an element to come. */
static dgfem_status dgfemi_split_add_child(dgfemi_splitter *s, const dgfemi_ints *codes, int component,
                                           dgfemi_split_child child) {
    const dgfem_hooks *hooks = &s->mesh->hooks;
    int k;
    if (s->child_count == s->child_capacity) {
        void *grown = dgfemi_grow(hooks, s->children, &s->child_capacity, s->child_count + 1, sizeof(child));
        if (!grown) return DGFEM_ERROR_MEMORY;
        s->children = (dgfemi_split_child *)grown;
    }
    if (!dgfemi_split_room(hooks, &s->child_faces, codes->count)) return DGFEM_ERROR_MEMORY;
    child.face_start = s->child_faces.count;
    for (k = 0; k < codes->count; k++)
        if (component == DGFEM_NONE || s->parts.component[k] == component)
            s->child_faces.data[s->child_faces.count++] = codes->data[k];
    child.face_count = s->child_faces.count - child.face_start;
    s->children[s->child_count++] = child;
    return DGFEM_OK;
}

/* Refuses parts without volume. Negative is a void, but only where there is no cap: beyond a cap is the outside. */
static dgfem_status dgfemi_split_check_volumes(const dgfemi_splitter *s, const dgfemi_split_child *child) {
    const dgfemi_parts *parts = &s->parts;
    int k;
    for (k = 0; k < parts->code_count; k++) {
        int face = parts->codes[k] / 2, is_cap = face >= child->cap_start && face < child->cap_end;
        dgfem_real volume = parts->volume[parts->component[k]];
        if (!(volume > 0) && !(volume < 0 && !is_cap))
            return dgfemi_fail(&s->mesh->hooks, DGFEM_ERROR_DEGENERATE,
                               "element %d: the plane leaves a part of volume %g", child->parent, (double)volume);
    }
    return DGFEM_OK;
}

/* Adds each component of one side, with its voids, as an element to come. */
static dgfem_status dgfemi_split_add_components(dgfemi_splitter *s, const dgfemi_ints *codes,
                                                const dgfemi_split_child *child) {
    dgfem_status status;
    int i;
    if (!dgfemi_parts_find(&s->parts, codes) || !dgfemi_parts_measure(&s->parts)) return DGFEM_ERROR_MEMORY;
    if (s->parts.crowded)
        return dgfemi_fail(&s->mesh->hooks, DGFEM_ERROR_INVARIANT, "element %d: a part meets itself at an edge",
                           child->parent);
    status = dgfemi_split_check_volumes(s, child);
    if (!status) status = dgfemi_parts_attach_voids(&s->parts);
    for (i = 0; !status && i < s->parts.count; i++)
        if (s->parts.volume[i] > 0) status = dgfemi_split_add_child(s, codes, i, *child);
    return status;
}

static dgfem_status dgfemi_split_element(dgfemi_splitter *s, int element) {
    dgfemi_split_child child;
    dgfem_status status;
    memset(&child, 0, sizeof child);
    child.parent = child.element = element;
    status = dgfemi_split_sort_faces(s, element);
    if (!status) status = dgfemi_split_close(s, element, &child.cap_start, &child.cap_end);
    for (child.side = -1; !status && child.side < 2; child.side += 2) {
        const dgfemi_ints *codes = child.side < 0 ? &s->below : &s->above;
        if (s->components) status = dgfemi_split_add_components(s, codes, &child);
        else status = dgfemi_split_add_child(s, codes, DGFEM_NONE, child);
    }
    return status;
}

/* ---- what lies outside the split ---- */

/* An element outside with its cut faces replaced by their parts. */
static dgfem_status dgfemi_split_renew_element(dgfemi_splitter *s, int element) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_element *e = &mesh->elements[element];
    dgfemi_split_child child;
    int k, i;
    memset(&child, 0, sizeof child);
    child.parent = child.element = element;
    s->below.count = 0;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        int f = mesh->element_faces[k], is_cut = s->cut[f].generation == s->generation;
        int first = is_cut ? s->cut[f].first : f, count = is_cut ? s->cut[f].below + s->cut[f].above : 1;
        for (i = 0; i < count; i++)
            if (!dgfemi_push(&mesh->hooks, &s->below, 2 * (first + i))) return DGFEM_ERROR_MEMORY;
    }
    return dgfemi_split_add_child(s, &s->below, DGFEM_NONE, child);
}

static dgfem_status dgfemi_split_renew_neighbours(dgfemi_splitter *s) {
    const dgfem_mesh *mesh = s->mesh;
    dgfem_status status = DGFEM_OK;
    int i, side;
    for (i = 0; !status && i < s->cut_faces.count; i++)
        for (side = 0; !status && side < 2; side++) {
            int element = mesh->faces[s->cut_faces.data[i]].element[side];
            if (element == DGFEM_NONE || s->element_mark[element] == s->generation) continue;
            s->element_mark[element] = s->generation;
            status = dgfemi_split_renew_element(s, element);
        }
    return status;
}

/* The crossing vertex on an edge, or DGFEM_NONE. */
static int dgfemi_split_find_crossing(const dgfemi_splitter *s, int a, int b) {
    const dgfemi_edge_slot *slot;
    if (dgfemi_split_sign(s, a) * dgfemi_split_sign(s, b) >= 0) return DGFEM_NONE;
    slot = dgfemi_edge_map_at(&s->crossings, a, b);
    return dgfemi_edge_map_has(&s->crossings, slot) ? slot->value : DGFEM_NONE;
}

static int dgfemi_split_has_crossing(const dgfemi_splitter *s, const dgfem_face *face) {
    const dgfem_mesh *mesh = s->mesh;
    int l, i;
    for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        int count = mesh->loops[l].count;
        for (i = 0; i < count; i++)
            if (dgfemi_split_find_crossing(s, loop[i], loop[i + 1 < count ? i + 1 : 0]) != DGFEM_NONE) return 1;
    }
    return 0;
}

/* New loops for a face, with the vertices on its split edges. */
static dgfem_status dgfemi_split_reloop_face(dgfemi_splitter *s, int f) {
    dgfem_mesh *mesh = s->mesh;
    const dgfem_hooks *hooks = &mesh->hooks;
    dgfem_face face = mesh->faces[f];
    int l, i, first = mesh->loop_count;
    for (l = face.loop_start; l < face.loop_start + face.loop_count; l++) {
        dgfem_loop loop = mesh->loops[l];
        s->scratch_a.count = 0;
        for (i = 0; i < loop.count; i++) {
            int a = mesh->loop_vertices[loop.start + i];
            int crossing = dgfemi_split_find_crossing(s, a, mesh->loop_vertices[loop.start + (i + 1) % loop.count]);
            if (!dgfemi_push(hooks, &s->scratch_a, a)) return DGFEM_ERROR_MEMORY;
            if (crossing != DGFEM_NONE && !dgfemi_push(hooks, &s->scratch_a, crossing)) return DGFEM_ERROR_MEMORY;
        }
        if (dgfemi_mesh_add_loop(mesh, s->scratch_a.data, s->scratch_a.count) == DGFEM_NONE) return DGFEM_ERROR_MEMORY;
    }
    if (s->reloop_count == s->reloop_capacity) {
        void *grown = dgfemi_grow(hooks, s->reloops, &s->reloop_capacity, s->reloop_count + 1,
                                  sizeof(dgfemi_split_reloop));
        if (!grown) return DGFEM_ERROR_MEMORY;
        s->reloops = (dgfemi_split_reloop *)grown;
    }
    s->reloops[s->reloop_count].face = f;
    s->reloops[s->reloop_count++].loop_start = first;
    return DGFEM_OK;
}

/* Enters the crossing vertices into the loops of faces that were not cut but run along a split edge: those of elements
   that touch the split ones at that edge alone, too. */
static dgfem_status dgfemi_split_reloop_faces(dgfemi_splitter *s) {
    dgfem_status status = DGFEM_OK;
    int f;
    for (f = 0; !status && f < s->face_count; f++) {
        const dgfem_face *face = &s->mesh->faces[f];
        if (face->element[0] == DGFEM_NONE || s->cut[f].generation == s->generation) continue;
        if (dgfemi_split_has_crossing(s, face)) status = dgfemi_split_reloop_face(s, f);
    }
    return status;
}

/* ---- commit ---- */

/* Puts a child where its parent was on one side of a face. A cap has the parent on both sides, below on side 0. */
static void dgfemi_split_set_side(dgfem_mesh *mesh, const dgfemi_split_child *child, int face) {
    dgfem_face *f = &mesh->faces[face];
    if (face >= child->cap_start && face < child->cap_end) f->element[child->side > 0] = child->element;
    else f->element[f->element[0] == child->parent ? 0 : 1] = child->element;
}

/* The first child of each parent takes its place, the others are appended. There is room for all. */
static void dgfemi_split_commit_children(dgfemi_splitter *s) {
    dgfem_mesh *mesh = s->mesh;
    int c, k, last_parent = DGFEM_NONE;
    for (c = 0; c < s->child_count; c++) {
        dgfemi_split_child *child = &s->children[c];
        dgfem_element *element;
        if (child->parent == last_parent) {
            child->element = mesh->element_count++;
            mesh->elements[child->element] = mesh->elements[child->parent];
        }
        last_parent = child->parent;
        element = &mesh->elements[child->element];
        element->face_start = mesh->element_face_count;
        element->face_count = child->face_count;
        for (k = child->face_start; k < child->face_start + child->face_count; k++) {
            int face = s->child_faces.data[k] / 2;
            mesh->element_faces[mesh->element_face_count++] = face;
            if (child->element != child->parent || face >= s->face_count) dgfemi_split_set_side(mesh, child, face);
        }
    }
}

static dgfem_status dgfemi_split_commit(dgfemi_splitter *s) {
    dgfem_mesh *mesh = s->mesh;
    int i;
    if (!dgfemi_mesh_reserve(mesh, 0, 0, s->child_count, 0, 0, s->child_faces.count)) return DGFEM_ERROR_MEMORY;
    dgfemi_split_commit_children(s);
    for (i = 0; i < s->cut_faces.count; i++) {
        dgfem_face *face = &mesh->faces[s->cut_faces.data[i]];
        face->element[0] = face->element[1] = DGFEM_NONE;
    }
    for (i = 0; i < s->reloop_count; i++) mesh->faces[s->reloops[i].face].loop_start = s->reloops[i].loop_start;
    if (!s->measure) return DGFEM_OK;
    for (i = s->face_count; i < mesh->face_count; i++) dgfemi_mesh_measure_face(mesh, i);
    for (i = 0; i < s->reloop_count; i++) dgfemi_mesh_measure_face(mesh, s->reloops[i].face);
    for (i = 0; i < s->child_count; i++) dgfemi_mesh_measure_element(mesh, s->children[i].element);
    return DGFEM_OK;
}

/* ---- the split ---- */

/* Room for the extents of all faces; those of new faces are not known. 1 on success, 0 when out of memory. */
static int dgfemi_split_fit_extents(dgfemi_splitter *s) {
    const dgfem_mesh *mesh = s->mesh;
    void *extent = s->extent;
    int ok = dgfemi_mesh_room(&mesh->hooks, &extent, 0, &s->extent_capacity, 2 * mesh->face_count, sizeof(dgfem_real));
    s->extent = (dgfem_real *)extent;
    for (; ok && s->extent_count < mesh->face_count; s->extent_count++)
        s->extent[2 * s->extent_count] = 1, s->extent[2 * s->extent_count + 1] = 0;
    return ok;
}

/* Empties what a call fills and remembers where the mesh ends. */
static dgfem_status dgfemi_split_begin(dgfemi_splitter *s) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_hooks *hooks = &mesh->hooks;
    void *cut = s->cut, *marks = s->element_mark;
    int ok = dgfemi_fit_zero(hooks, &cut, &s->cut_capacity, mesh->face_count, sizeof(dgfemi_cut_face));
    s->cut = (dgfemi_cut_face *)cut;
    ok = ok && dgfemi_fit_zero(hooks, &marks, &s->element_mark_capacity, mesh->element_count, sizeof(unsigned));
    s->element_mark = (unsigned *)marks;
    ok = ok && (s->axis == DGFEM_NONE || dgfemi_split_fit_extents(s));
    s->vertex_count = mesh->vertex_count, s->face_count = mesh->face_count;
    s->loop_count = mesh->loop_count, s->loop_vertex_count = mesh->loop_vertex_count;
    s->child_count = s->reloop_count = 0;
    s->child_faces.count = s->cut_faces.count = 0;
    if (++s->generation == 0) {
        memset(s->cut, 0, (size_t)s->cut_capacity * sizeof(dgfemi_cut_face));
        memset(s->element_mark, 0, (size_t)s->element_mark_capacity * sizeof(unsigned));
        s->generation = 1;
    }
    return ok && dgfemi_edge_map_begin(hooks, &s->crossings, s->crossings.size / 2) ? DGFEM_OK : DGFEM_ERROR_MEMORY;
}

/* Forgets all that was appended. */
static void dgfemi_split_roll_back(dgfemi_splitter *s) {
    dgfem_mesh *mesh = s->mesh;
    mesh->vertex_count = s->vertex_count, mesh->face_count = s->face_count;
    mesh->loop_count = s->loop_count, mesh->loop_vertex_count = s->loop_vertex_count;
}

/* Splits elements that all have vertices below and above the plane that is set. Their children are s->children[]; the
   first one of each parent is below and keeps the parent's index. On failure the mesh is as it was. */
static dgfem_status dgfemi_split_straddling(dgfemi_splitter *s, const int *elements, int count) {
    dgfem_status status = dgfemi_split_begin(s);
    int i;
    for (i = 0; !status && i < count; i++) {
        s->element_mark[elements[i]] = s->generation;
        status = dgfemi_split_element(s, elements[i]);
        s->failed_element = elements[i];
    }
    if (!status && !s->all) status = dgfemi_split_renew_neighbours(s);
    if (!status && !s->all) status = dgfemi_split_reloop_faces(s);
    if (!status) status = dgfemi_split_commit(s);
    if (status) dgfemi_split_roll_back(s);
    return status == DGFEM_ERROR_MEMORY ? dgfemi_fail_memory(&s->mesh->hooks) : status;
}

/* ---- axis planes ---- */

/* Prepares for planes across an axis. 1 on success, 0 when out of memory. */
static int dgfemi_split_set_axis(dgfemi_splitter *s, int axis) {
    const dgfem_mesh *mesh = s->mesh;
    void *height = s->height;
    int v, ok = dgfemi_mesh_room(&mesh->hooks, &height, 0, &s->height_capacity, mesh->vertex_count, sizeof(dgfem_real));
    s->height = (dgfem_real *)height;
    if (!ok) return 0;
    s->axis = axis;
    s->normal = dgfemi_vec3(axis == 0, axis == 1, axis == 2);
    s->snapped = 0;
    s->extent_count = 0;
    for (v = 0; v < mesh->vertex_count; v++) s->height[v] = dgfemi_axis(mesh->vertices[v], axis);
    return dgfemi_split_fit_extents(s);
}

/* ---- any plane ---- */

/* Heights of all vertices above the plane. What round-off alone may have put beside it counts as on it, so that a second
   cut where there is one already changes nothing. 1 on success, 0 when out of memory. */
static int dgfemi_split_set_plane(dgfemi_splitter *s, dgfem_plane plane) {
    const dgfem_mesh *mesh = s->mesh;
    dgfem_vec3 n = plane.normal;
    dgfem_real size = dgfemi_abs(plane.offset);
    void *height = s->height;
    int v, ok = dgfemi_mesh_room(&mesh->hooks, &height, 0, &s->height_capacity, mesh->vertex_count, sizeof(dgfem_real));
    s->height = (dgfem_real *)height;
    if (!ok) return 0;
    s->axis = DGFEM_NONE;
    s->plane = plane;
    s->normal = dgfemi_abs(dgfemi_dot(n, n) - 1) <= 4 * DGFEM_EPSILON ? n : dgfemi_normalized(n);
    s->snapped = 0;
    for (v = 0; v < mesh->vertex_count; v++) {
        dgfem_vec3 p = mesh->vertices[v];
        size = dgfemi_max(size, dgfemi_abs(n.x * p.x) + dgfemi_abs(n.y * p.y) + dgfemi_abs(n.z * p.z));
        s->height[v] = dgfemi_dot(n, p) - plane.offset;
    }
    s->high = 16 * DGFEM_EPSILON * size;
    s->low = -s->high;
    return 1;
}

static void dgfemi_split_mark_edge(dgfemi_splitter *s, int a, int b) {
    dgfem_real height_a = dgfemi_abs(s->height[a]), height_b = dgfemi_abs(s->height[b]);
    if (dgfemi_split_sign(s, a) * dgfemi_split_sign(s, b) >= 0) return;
    if (height_a < s->snap * height_b && s->snap_mark[a] == 0) s->snap_mark[a] = 1;
    if (height_b < s->snap * height_a && s->snap_mark[b] == 0) s->snap_mark[b] = 1;
}

/* Marks the vertices of an element that are near the plane compared with the other end of an edge that crosses it. */
static void dgfemi_split_mark_element(dgfemi_splitter *s, int element) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_element *e = &mesh->elements[element];
    int k, l, i;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
            const int *loop = mesh->loop_vertices + mesh->loops[l].start;
            int count = mesh->loops[l].count;
            for (i = 0; i < count; i++) dgfemi_split_mark_edge(s, loop[i], loop[i + 1 < count ? i + 1 : 0]);
        }
    }
}

static int dgfemi_split_straddles(const dgfemi_splitter *s, int element) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_element *e = &mesh->elements[element];
    int k, below = 0, above = 0;
    for (k = e->face_start; k < e->face_start + e->face_count && !(below && above); k++) {
        dgfemi_face_signs signs = dgfemi_split_count_signs(s, &mesh->faces[mesh->element_faces[k]]);
        below |= signs.below, above |= signs.above;
    }
    return below && above;
}

/* 1 when the vertices strictly between corners `first` and `end` of a loop lie on the line through these two. */
static int dgfemi_split_is_straight(const dgfemi_splitter *s, const int *loop, int count, int first, int end) {
    const dgfem_vec3 *vertices = s->mesh->vertices;
    dgfem_vec3 a = vertices[loop[first % count]], along = dgfemi_sub(vertices[loop[end % count]], a);
    dgfem_real tolerance = 4 * s->high / dgfemi_norm(s->plane.normal) * dgfemi_norm(along);
    int i;
    for (i = first + 1; i < end; i++)
        if (!(dgfemi_norm(dgfemi_cross(dgfemi_sub(vertices[loop[i % count]], a), along)) <= tolerance)) return 0;
    return 1;
}

/* Where both ends of a straight run of edges are on the plane, or marked, so are the vertices between them: with them
   beside it the run would enclose a sliver without area. Returns the number of new marks. */
static int dgfemi_split_mark_runs(dgfemi_splitter *s, const int *loop, int count) {
    int first, end, i, marks = 0;
    for (first = 0; first < count; first++) {
        if (s->snap_mark[loop[first]] != 1 && dgfemi_split_sign(s, loop[first]) != 0) continue;
        for (end = first + 1; end < first + count; end++)
            if (s->snap_mark[loop[end % count]] == 1 || dgfemi_split_sign(s, loop[end % count]) == 0) break;
        if (end == first + 1 || end == first + count || !dgfemi_split_is_straight(s, loop, count, first, end)) continue;
        for (i = first + 1; i < end; i++)
            if (s->snap_mark[loop[i % count]] == 0) s->snap_mark[loop[i % count]] = 1, marks++;
    }
    return marks;
}

static int dgfemi_split_mark_runs_of(dgfemi_splitter *s, int element) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_element *e = &mesh->elements[element];
    int k, l, marks = 0;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            marks += dgfemi_split_mark_runs(s, mesh->loop_vertices + mesh->loops[l].start, mesh->loops[l].count);
    }
    return marks;
}

/* Makes all marks zero. 1 on success, 0 when out of memory. */
static int dgfemi_split_clear_marks(dgfemi_splitter *s) {
    const dgfem_mesh *mesh = s->mesh;
    void *snap_mark = s->snap_mark;
    int ok = dgfemi_mesh_room(&mesh->hooks, &snap_mark, 0, &s->snap_mark_capacity, mesh->vertex_count, 1);
    s->snap_mark = (signed char *)snap_mark;
    if (ok && mesh->vertex_count > 0) memset(s->snap_mark, 0, (size_t)mesh->vertex_count);
    return ok;
}

/* Puts the vertices of the elements that are to be snapped on the plane. */
static void dgfemi_split_snap(dgfemi_splitter *s, const int *elements, int count) {
    int i, v, marks;
    for (v = 0; v < s->mesh->vertex_count; v++)
        if (s->snap_mark[v] == 1) s->snap_mark[v] = 0;
    for (i = 0; i < count; i++) dgfemi_split_mark_element(s, elements ? elements[i] : i);
    do {
        for (marks = 0, i = 0; i < count; i++) marks += dgfemi_split_mark_runs_of(s, elements ? elements[i] : i);
    } while (marks > 0);
    for (v = 0; v < s->mesh->vertex_count; v++)
        if (s->snap_mark[v] == 1) s->height[v] = 0, s->snapped = 1;
}

/* Sets the plane and selects those of the elements (NULL: of the first `count`) that straddle it. */
static dgfem_status dgfemi_split_select(dgfemi_splitter *s, dgfem_plane plane, const int *elements, int count) {
    int i;
    if (!dgfemi_split_set_plane(s, plane)) return dgfemi_fail_memory(&s->mesh->hooks);
    if (s->snap > 0) dgfemi_split_snap(s, elements, count);
    s->selected.count = 0;
    for (i = 0; i < count; i++) {
        int element = elements ? elements[i] : i;
        if (dgfemi_split_straddles(s, element) && !dgfemi_push(&s->mesh->hooks, &s->selected, element))
            return dgfemi_fail_memory(&s->mesh->hooks);
    }
    return DGFEM_OK;
}

/* One attempt; where vertices were snapped it fails silently. */
static dgfem_status dgfemi_split_try(dgfemi_splitter *s, dgfem_plane plane, const int *elements, int count) {
    dgfem_hooks hooks = s->mesh->hooks;
    dgfem_status status = dgfemi_split_select(s, plane, elements, count);
    if (status) return status;
    if (s->snapped) s->mesh->hooks.log = NULL;
    status = dgfemi_split_straddling(s, s->selected.data, s->selected.count);
    s->mesh->hooks.log = hooks.log;
    return s->snapped && status == DGFEM_ERROR_MEMORY ? dgfemi_fail_memory(&hooks) : status;
}

/* Forbids to snap the vertices of an element. */
static void dgfemi_split_release(dgfemi_splitter *s, int element) {
    const dgfem_mesh *mesh = s->mesh;
    const dgfem_element *e = &mesh->elements[element];
    int k, l, i;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        for (l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            for (i = 0; i < mesh->loops[l].count; i++)
                s->snap_mark[mesh->loop_vertices[mesh->loops[l].start + i]] = -1;
    }
}

/* Splits those of the given elements (NULL: of the first `count`) that straddle the plane, in place; they are
   s->selected, their children s->children. On failure the mesh is as it was. Leaves dead items. An element that does not
   take the snapping well keeps its vertices off the plane. */
static dgfem_status dgfemi_split_elements(dgfemi_splitter *s, dgfem_plane plane, const int *elements, int count) {
    enum { MAX_RELEASES = 16 };
    dgfem_real snap = s->snap;
    dgfem_status status;
    int releases;
    if (snap > 0 && !dgfemi_split_clear_marks(s)) return dgfemi_fail_memory(&s->mesh->hooks);
    status = dgfemi_split_try(s, plane, elements, count);
    for (releases = 1; status && status != DGFEM_ERROR_MEMORY && s->snapped; releases++) {
        dgfemi_split_release(s, s->failed_element);
        if (releases == MAX_RELEASES) s->snap = 0;
        status = dgfemi_split_try(s, plane, elements, count);
    }
    s->snap = snap;
    return status;
}

static dgfem_status dgfemi_split_check_plane(const dgfem_hooks *hooks, dgfem_plane plane) {
    dgfem_vec3 n = plane.normal;
    if (!dgfemi_is_finite3(n) || !dgfemi_is_finite(plane.offset))
        return dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "plane: normal %g %g %g, offset %g", (double)n.x, (double)n.y,
                           (double)n.z, (double)plane.offset);
    if (!(dgfemi_norm(n) > 0)) return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "plane: its normal is zero");
    return DGFEM_OK;
}

/* On a copy, because the compaction, too, can fail. */
static dgfem_status dgfemi_mesh_split(dgfem_mesh *mesh, dgfem_plane plane, dgfem_real snap, int *split) {
    dgfem_mesh *copy = dgfemi_mesh_duplicate(mesh);
    dgfemi_splitter s;
    dgfem_status status;
    if (!copy) return dgfemi_fail_memory(&mesh->hooks);
    s = dgfemi_splitter_make(copy);
    s.snap = snap;
    s.components = s.all = s.measure = 1;
    status = dgfemi_split_elements(&s, plane, NULL, copy->element_count);
    if (!status && s.selected.count > 0) status = dgfemi_mesh_compact(copy);
    if (!status) {
        *split = s.selected.count;
        dgfemi_mesh_swap(mesh, copy);
    }
    dgfemi_splitter_free(&s);
    dgfem_mesh_destroy(copy);
    return status;
}

DGFEM_API dgfem_status dgfem_mesh_split_plane(dgfem_mesh *mesh, dgfem_plane plane, dgfem_real snap, int *split) {
    dgfem_status status;
    int count = 0;
    if (split) *split = 0;
    if (!mesh) return DGFEM_ERROR_ARGUMENT;
    status = dgfemi_split_check_plane(&mesh->hooks, plane);
    if (status) return status;
    if (!(snap >= 0) || !(snap < 1))
        return dgfemi_fail(&mesh->hooks, DGFEM_ERROR_ARGUMENT, "snap %g is not in [0, 1)", (double)snap);
    status = dgfemi_mesh_split(mesh, plane, snap, &count);
    if (!status && split) *split = count;
    return status;
}

/* ---- the stand-alone polyhedron ---- */

/* The polyhedron as a mesh of one element, not measured; NULL when out of memory. */
static dgfem_mesh *dgfemi_polyhedron_to_mesh(const dgfem_polyhedron *polyhedron) {
    dgfem_mesh *mesh = dgfemi_mesh_new(&polyhedron->hooks);
    int faces = polyhedron->face_count, loops = polyhedron->face_loops[faces], f, l, v;
    if (!mesh) return NULL;
    if (!dgfemi_mesh_reserve(mesh, polyhedron->vertex_count, faces, 1, loops, polyhedron->loop_start[loops], faces)) {
        dgfem_mesh_destroy(mesh);
        return NULL;
    }
    for (v = 0; v < polyhedron->vertex_count; v++) (void)dgfemi_mesh_add_vertex(mesh, polyhedron->vertices[v]);
    for (f = 0; f < faces; f++) {
        int first = polyhedron->face_loops[f], end = polyhedron->face_loops[f + 1];
        for (l = first; l < end; l++)
            (void)dgfemi_mesh_add_loop(mesh, polyhedron->loop_vertices + polyhedron->loop_start[l],
                                       polyhedron->loop_start[l + 1] - polyhedron->loop_start[l]);
        (void)dgfemi_mesh_add_face(mesh, first, end - first, 0, DGFEM_NONE, f, dgfemi_vec3(0, 0, 0));
        mesh->faces[f].normal = dgfemi_mesh_unit_normal(mesh, f);
        mesh->element_faces[f] = f;
    }
    mesh->element_face_count = faces;
    mesh->element_count = 1;
    memset(mesh->elements, 0, sizeof(dgfem_element));
    mesh->elements[0].face_count = faces;
    return mesh;
}

/* Every directed edge of the only element must have its opposite: else a cut does not close. */
static dgfem_status dgfemi_split_check_closed(const dgfem_mesh *mesh) {
    const dgfem_hooks *hooks = &mesh->hooks;
    dgfem_status status = DGFEM_OK;
    dgfemi_edges edges;
    int f, i;
    memset(&edges, 0, sizeof edges);
    if (!dgfemi_edges_reset(hooks, &edges, mesh->loop_vertex_count)) status = dgfemi_fail_memory(hooks);
    for (f = 0; !status && f < mesh->face_count; f++) dgfemi_edges_add_face(mesh, &edges, f, 1);
    for (i = 0; !status && i < edges.count; i++) {
        const dgfemi_edge *edge = &edges.data[i];
        if (edge->forward != edge->backward)
            status = dgfemi_fail(hooks, DGFEM_ERROR_OPEN, "edge from vertex %d to %d occurs %d times, its opposite %d",
                                 edge->a, edge->b, edge->forward, edge->backward);
    }
    dgfemi_edges_free(hooks, &edges);
    return status;
}

/* The parts of a mesh of one element, each with all its components. */
static dgfem_status dgfemi_split_parts(dgfem_mesh *mesh, dgfem_plane plane, dgfem_polyhedron *parts[2]) {
    dgfemi_splitter s = dgfemi_splitter_make(mesh);
    dgfem_status status;
    int i, element = 0;
    s.all = 1;
    status = dgfemi_split_elements(&s, plane, &element, 1);
    if (!status && s.selected.count > 0) {
        status = dgfem_mesh_element_polyhedron(mesh, 0, &parts[0]);
        if (!status) status = dgfem_mesh_element_polyhedron(mesh, 1, &parts[1]);
    } else if (!status) {
        for (i = 0; i < mesh->loop_vertex_count && dgfemi_split_sign(&s, mesh->loop_vertices[i]) >= 0; i++) {}
        status = dgfem_mesh_element_polyhedron(mesh, 0, &parts[i == mesh->loop_vertex_count]);
    }
    dgfemi_splitter_free(&s);
    return status;
}

DGFEM_API dgfem_status dgfem_polyhedron_split(const dgfem_polyhedron *polyhedron, dgfem_plane plane,
                                              dgfem_polyhedron **below, dgfem_polyhedron **above) {
    dgfem_polyhedron *parts[2] = {NULL, NULL};
    dgfem_mesh *mesh;
    dgfem_status status;
    if (below) *below = NULL;
    if (above) *above = NULL;
    if (!polyhedron || !below || !above) return DGFEM_ERROR_ARGUMENT;
    status = dgfemi_split_check_plane(&polyhedron->hooks, plane);
    if (status) return status;
    mesh = dgfemi_polyhedron_to_mesh(polyhedron);
    if (!mesh) return dgfemi_fail_memory(&polyhedron->hooks);
    status = dgfemi_split_check_closed(mesh);
    if (!status) status = dgfemi_split_parts(mesh, plane, parts);
    dgfem_mesh_destroy(mesh);
    if (status) {
        dgfem_polyhedron_destroy(parts[0]);
        dgfem_polyhedron_destroy(parts[1]);
        return status;
    }
    *below = parts[0], *above = parts[1];
    return DGFEM_OK;
}

/* ==== slice.c ===================================================================================================== */

/* Closed triangle surface x hexahedral grid -> mesh.

   The surface becomes one element with a face per triangle. The grid's planes split it, one axis after the other, so
   that both neighbours of a new face share it from the start. At the end each cell's part is taken apart into its
   components, and these are the elements. */

DGFEM_API dgfem_slice_desc dgfem_default_slice_desc(void) {
    dgfem_slice_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.cells = 10;
    desc.grid_cell = dgfemi_vec3(1, 1, 1);
    desc.grid_cells[0] = desc.grid_cells[1] = desc.grid_cells[2] = 1;
    desc.sliver = DGFEM_R(1e-3);
    return desc;
}

typedef struct dgfemi_slicer {
    const dgfem_slice_desc *desc;
    const dgfem_hooks *hooks;
    dgfem_mesh *mesh;        /* holds the surface's vertices from the start */
    dgfemi_arena arena;
    int *triangles;          /* [3 * count] half-edge h runs from triangles[h] to triangles[dgfemi_half_edge_next(h)] */
    dgfem_vec3 *normals;     /* [count] unit */
    int *twin;               /* [3 * count] the opposite half-edge of the same solid corner */
    int *chain;              /* [3 * count] previous half-edge on the same edge, or DGFEM_NONE */
    int *middle;             /* [3 * count] vertex inserted into the half-edge, or DGFEM_NONE */
    int *shell;              /* [count] union-find over triangles that share edges; a root is its shell's first triangle */
    int count;               /* of triangles */
    dgfem_vec3 lower, upper; /* box of the vertices in use */
    double volume, area;
    dgfemi_lattice lattice;
    dgfemi_splitter splitter;
    dgfem_real *low, *high;  /* [element_count] extent along the axis at work */
    int low_capacity, high_capacity;
} dgfemi_slicer;

static int dgfemi_half_edge_next(int h) { return h % 3 == 2 ? h - 2 : h + 1; }

/* ---- the input ---- */

static dgfem_status dgfemi_slice_check_grid(const dgfem_slice_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    double cells = 1;
    int axis;
    if (!desc->use_grid) {
        if (desc->cells < 1) return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "slice: %d cells", desc->cells);
        return DGFEM_OK;
    }
    if (!dgfemi_is_finite3(desc->grid_lower) || !dgfemi_is_finite3(desc->grid_cell))
        return dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "slice: grid_lower or grid_cell");
    for (axis = 0; axis < 3; axis++) {
        if (!(dgfemi_axis(desc->grid_cell, axis) > 0))
            return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "slice: grid_cell is %g along axis %d",
                               (double)dgfemi_axis(desc->grid_cell, axis), axis);
        if (desc->grid_cells[axis] < 1)
            return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "slice: %d grid_cells along axis %d",
                               desc->grid_cells[axis], axis);
        cells *= desc->grid_cells[axis];
    }
    if (cells > INT_MAX) return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "slice: a grid of %g cells", cells);
    return DGFEM_OK;
}

static dgfem_status dgfemi_slice_check_desc(const dgfem_slice_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    const dgfem_points_in *points = &desc->vertices;
    dgfem_status status = dgfemi_check_points(hooks, points->data, points->type, points->stride, points->count,
                                              "slice: vertices");
    if (status) return status;
    if (desc->triangle_count < 0 || desc->triangle_count > INT_MAX / 3 || (desc->triangle_count > 0 && !desc->triangles))
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "slice: no data for %d triangles", desc->triangle_count);
    if (!(desc->sliver >= 0) || !(desc->sliver < 1))
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "slice: sliver %g is not in [0, 1)", (double)desc->sliver);
    status = dgfemi_slice_check_grid(desc);
    if (status) return status;
    if (desc->triangle_count == 0) return dgfemi_fail(hooks, DGFEM_ERROR_EMPTY, "slice: the surface has no triangles");
    return DGFEM_OK;
}

static dgfem_status dgfemi_slice_read_vertices(dgfemi_slicer *slicer) {
    const dgfem_points_in *points = &slicer->desc->vertices;
    dgfem_mesh *mesh = slicer->mesh;
    int v;
    if (!dgfemi_mesh_reserve(mesh, points->count, 0, 0, 0, 0, 0)) return dgfemi_fail_memory(slicer->hooks);
    for (v = 0; v < points->count; v++) {
        mesh->vertices[v] = dgfemi_point_read(points, v);
        if (!dgfemi_is_finite3(mesh->vertices[v]))
            return dgfemi_fail(slicer->hooks, DGFEM_ERROR_NOT_FINITE, "vertex %d", v);
    }
    mesh->vertex_count = points->count;
    return DGFEM_OK;
}

/* Copies the triangles and finds their box. */
static dgfem_status dgfemi_slice_read_triangles(dgfemi_slicer *slicer) {
    const dgfem_mesh *mesh = slicer->mesh;
    const size_t count = (size_t)slicer->count;
    int t, i;
    slicer->triangles = (int *)dgfemi_arena_allocate(&slicer->arena, 3 * count, sizeof(int));
    slicer->twin = (int *)dgfemi_arena_allocate(&slicer->arena, 3 * count, sizeof(int));
    slicer->chain = (int *)dgfemi_arena_allocate(&slicer->arena, 3 * count, sizeof(int));
    slicer->middle = (int *)dgfemi_arena_allocate(&slicer->arena, 3 * count, sizeof(int));
    slicer->shell = (int *)dgfemi_arena_allocate(&slicer->arena, count, sizeof(int));
    slicer->normals = (dgfem_vec3 *)dgfemi_arena_allocate(&slicer->arena, count, sizeof(dgfem_vec3));
    if (!slicer->triangles || !slicer->twin || !slicer->chain || !slicer->middle || !slicer->shell ||
        !slicer->normals)
        return dgfemi_fail_memory(slicer->hooks);
    for (t = 0; t < slicer->count; t++) {
        const int *v = slicer->desc->triangles + 3 * t;
        for (i = 0; i < 3; i++) {
            if (v[i] < 0 || v[i] >= mesh->vertex_count)
                return dgfemi_fail(slicer->hooks, DGFEM_ERROR_INDEX, "triangle %d refers to vertex %d of %d", t, v[i],
                                   mesh->vertex_count);
            if (v[i] == v[(i + 1) % 3])
                return dgfemi_fail(slicer->hooks, DGFEM_ERROR_DEGENERATE, "triangle %d has vertex %d twice", t, v[i]);
            slicer->triangles[3 * t + i] = v[i];
            if (t == 0 && i == 0) slicer->lower = slicer->upper = mesh->vertices[v[i]];
            slicer->lower = dgfemi_min3(slicer->lower, mesh->vertices[v[i]]);
            slicer->upper = dgfemi_max3(slicer->upper, mesh->vertices[v[i]]);
        }
    }
    return DGFEM_OK;
}

/* ---- the grid ---- */

/* Cubic cells of edge 1.0001 * longest extent / cells, centred on the box. */
static dgfem_status dgfemi_slice_default_grid(dgfemi_slicer *slicer) {
    dgfemi_lattice *lattice = &slicer->lattice;
    dgfem_vec3 extent = dgfemi_sub(slicer->upper, slicer->lower);
    dgfem_real longest = dgfemi_max(extent.x, dgfemi_max(extent.y, extent.z));
    dgfem_real edge = DGFEM_R(1.0001) * longest / (dgfem_real)slicer->desc->cells;
    double cells = 1;
    int axis;
    if (!dgfemi_is_finite3(extent))
        return dgfemi_fail(slicer->hooks, DGFEM_ERROR_NOT_FINITE, "the surface's bounding box overflows");
    if (!(edge > 0)) return dgfemi_fail(slicer->hooks, DGFEM_ERROR_DEGENERATE, "the surface has no extent");
    for (axis = 0; axis < 3; axis++) {
        dgfem_real length = dgfemi_axis(extent, axis);
        int count = (int)ceil((double)(length / edge));
        count = count < 1 ? 1 : count;
        lattice->cell[axis] = edge;
        lattice->cells[axis] = count;
        lattice->lower[axis] = dgfemi_axis(slicer->lower, axis) + (length - (dgfem_real)count * edge) / 2;
        cells *= count;
    }
    if (cells > INT_MAX) return dgfemi_fail(slicer->hooks, DGFEM_ERROR_ARGUMENT, "slice: a grid of %g cells", cells);
    return DGFEM_OK;
}

static dgfem_status dgfemi_slice_given_grid(dgfemi_slicer *slicer) {
    dgfemi_lattice *lattice = &slicer->lattice;
    int axis;
    for (axis = 0; axis < 3; axis++) {
        dgfem_real upper;
        lattice->lower[axis] = dgfemi_axis(slicer->desc->grid_lower, axis);
        lattice->cell[axis] = dgfemi_axis(slicer->desc->grid_cell, axis);
        lattice->cells[axis] = slicer->desc->grid_cells[axis];
        upper = dgfemi_lattice_plane(lattice, axis, lattice->cells[axis]);
        if (lattice->lower[axis] > dgfemi_axis(slicer->upper, axis) || upper < dgfemi_axis(slicer->lower, axis))
            return dgfemi_fail(slicer->hooks, DGFEM_ERROR_EMPTY,
                               "the grid, %g to %g along axis %d, does not touch the surface, %g to %g",
                               (double)lattice->lower[axis], (double)upper, axis,
                               (double)dgfemi_axis(slicer->lower, axis), (double)dgfemi_axis(slicer->upper, axis));
    }
    return DGFEM_OK;
}

/* Sets the grid and moves vertices that only round-off keeps off its planes onto them. */
static dgfem_status dgfemi_slice_set_grid(dgfemi_slicer *slicer) {
    dgfem_mesh *mesh = slicer->mesh;
    dgfem_vec3 lower = slicer->lower, upper = slicer->upper;
    dgfem_real x = dgfemi_max(dgfemi_abs(lower.x), dgfemi_abs(upper.x));
    dgfem_real y = dgfemi_max(dgfemi_abs(lower.y), dgfemi_abs(upper.y));
    dgfem_real z = dgfemi_max(dgfemi_abs(lower.z), dgfemi_abs(upper.z));
    dgfem_status status = slicer->desc->use_grid ? dgfemi_slice_given_grid(slicer) : dgfemi_slice_default_grid(slicer);
    int v;
    slicer->lattice.noise = 8 * DGFEM_EPSILON * dgfemi_max(x, dgfemi_max(y, z));
    for (v = 0; !status && v < mesh->vertex_count; v++) dgfemi_lattice_snap(&slicer->lattice, &mesh->vertices[v]);
    return status;
}

/* ---- the surface ---- */

/* Normals and total area. */
static dgfem_status dgfemi_slice_measure_triangles(dgfemi_slicer *slicer) {
    const dgfem_vec3 *vertices = slicer->mesh->vertices;
    int t;
    for (t = 0; t < slicer->count; t++) {
        const int *v = slicer->triangles + 3 * t;
        dgfem_vec3 ab = dgfemi_sub(vertices[v[1]], vertices[v[0]]), bc = dgfemi_sub(vertices[v[2]], vertices[v[1]]);
        dgfem_vec3 normal = dgfemi_cross(ab, bc);
        dgfem_real twice = dgfemi_norm(normal);
        if (!(twice > 4 * DGFEM_EPSILON * dgfemi_norm(ab) * dgfemi_norm(bc)))
            return dgfemi_fail(slicer->hooks, DGFEM_ERROR_DEGENERATE, "triangle %d (vertices %d %d %d) has no area", t,
                               v[0], v[1], v[2]);
        slicer->normals[t] = dgfemi_normalized(normal);
        slicer->area += 0.5 * (double)twice;
    }
    return DGFEM_OK;
}

/* How many more half-edges run from the lower to the higher vertex than back. */
static int dgfemi_slice_balance(const dgfemi_slicer *slicer, int h) {
    int balance = 0;
    for (; h != DGFEM_NONE; h = slicer->chain[h])
        balance += slicer->triangles[h] < slicer->triangles[dgfemi_half_edge_next(h)] ? 1 : -1;
    return balance;
}

/* Chains the half-edges on each edge, in slicer->splitter.crossings; refuses edges where these do not cancel, naming
   the one that the first triangle has. */
static dgfem_status dgfemi_slice_chain_edges(dgfemi_slicer *slicer) {
    dgfemi_edge_map *map = &slicer->splitter.crossings;
    int h, open = DGFEM_NONE;
    size_t i;
    if (!dgfemi_edge_map_begin(slicer->hooks, map, 3 * (size_t)slicer->count / 2)) return dgfemi_fail_memory(slicer->hooks);
    for (h = 0; h < 3 * slicer->count; h++) {
        int a = slicer->triangles[h], b = slicer->triangles[dgfemi_half_edge_next(h)];
        dgfemi_edge_slot *slot = dgfemi_edge_map_at(map, a, b);
        slicer->chain[h] = DGFEM_NONE;
        if (dgfemi_edge_map_has(map, slot)) {
            slicer->chain[h] = slot->value;
            slot->value = h;
        } else if (!dgfemi_edge_map_set(slicer->hooks, map, slot, a, b, h)) {
            return dgfemi_fail_memory(slicer->hooks);
        }
    }
    for (i = 0; i < map->size; i++) {
        if (!dgfemi_edge_map_has(map, &map->slots[i]) || dgfemi_slice_balance(slicer, map->slots[i].value) == 0) continue;
        for (h = map->slots[i].value; slicer->chain[h] != DGFEM_NONE; h = slicer->chain[h]) {}
        if (open == DGFEM_NONE || h < open) open = h;
    }
    if (open != DGFEM_NONE)
        return dgfemi_fail(slicer->hooks, DGFEM_ERROR_OPEN, "edge between vertices %d and %d, of triangle %d",
                           slicer->triangles[open], slicer->triangles[dgfemi_half_edge_next(open)], open / 3);
    return DGFEM_OK;
}

/* ---- edges with more than two triangles ---- */

/* A triangle at an edge that runs towards the viewer, lower vertex first, and where it is around the edge. A triangle
   that has the edge in that sense (closing) has its solid on the clockwise side:

            \ closing               solid corners, each from an opening triangle counter-clockwise
       solid \                      to the next closing one
              o------ opening                                                                          */
typedef struct dgfemi_spoke {
    dgfem_real angle; /* grows from 0 to 4 */
    int half_edge, closing;
} dgfemi_spoke;

static int dgfemi_spoke_compare(const void *a, const void *b) {
    const dgfemi_spoke *x = (const dgfemi_spoke *)a, *y = (const dgfemi_spoke *)b;
    if (x->angle < y->angle) return -1;
    if (x->angle > y->angle) return 1;
    if (x->closing != y->closing) return y->closing - x->closing; /* solids that touch, not a solid without thickness */
    return (x->half_edge > y->half_edge) - (x->half_edge < y->half_edge);
}

/* Sorts the triangles at an edge by angle. */
static void dgfemi_slice_sort_spokes(const dgfemi_slicer *slicer, int last, dgfemi_spoke *spokes, int count) {
    const dgfem_vec3 *vertices = slicer->mesh->vertices;
    const int *triangles = slicer->triangles;
    int a = triangles[last], b = triangles[dgfemi_half_edge_next(last)], first_apex, i, h;
    dgfem_vec3 origin = vertices[a < b ? a : b], along = dgfemi_sub(vertices[a < b ? b : a], origin), x, y;
    first_apex = triangles[dgfemi_half_edge_next(dgfemi_half_edge_next(last))];
    x = dgfemi_sub(vertices[first_apex], origin);
    y = dgfemi_normalized(dgfemi_cross(along, x));
    x = dgfemi_normalized(dgfemi_cross(y, along));
    for (i = 0, h = last; i < count; i++, h = slicer->chain[h]) {
        int apex = triangles[dgfemi_half_edge_next(dgfemi_half_edge_next(h))];
        dgfem_vec3 d = dgfemi_sub(vertices[apex], origin);
        dgfem_real u = dgfemi_dot(d, x), v = dgfemi_dot(d, y), sum = dgfemi_abs(u) + dgfemi_abs(v);
        u = sum > 0 ? u / sum : 1;
        spokes[i].angle = apex == first_apex ? 0 : v >= 0 ? 1 - u : 3 + u;
        spokes[i].half_edge = h;
        spokes[i].closing = triangles[h] < triangles[dgfemi_half_edge_next(h)];
    }
    qsort(spokes, (size_t)count, sizeof(dgfemi_spoke), dgfemi_spoke_compare);
}

/* Pairs the triangles of each solid corner, like brackets in a circle. `stack` has room for `count`. */
static void dgfemi_slice_pair_spokes(dgfemi_slicer *slicer, const dgfemi_spoke *spokes, int count, int *stack) {
    int depth = 0, i;
    for (i = 0; i < 2 * count; i++) { /* twice around: what is left open at first is closed then */
        const dgfemi_spoke *spoke = &spokes[i % count];
        if (slicer->twin[spoke->half_edge] != DGFEM_NONE) continue;
        if (!spoke->closing) {
            if (i < count) stack[depth++] = spoke->half_edge;
        } else if (depth > 0) {
            int opening = stack[--depth];
            slicer->twin[opening] = spoke->half_edge;
            slicer->twin[spoke->half_edge] = opening;
        }
    }
}

/* Tells apart the solid corners at an edge with more than two triangles: all but the first get a vertex of their own in
   the middle, so that no two of them share an edge. */
static dgfem_status dgfemi_slice_part_edge(dgfemi_slicer *slicer, int last, int corners) {
    dgfem_mesh *mesh = slicer->mesh;
    int h, corner = 0;
    for (h = last; h != DGFEM_NONE; h = slicer->chain[h]) {
        int a = slicer->triangles[h], b = slicer->triangles[dgfemi_half_edge_next(h)];
        dgfem_vec3 pa = mesh->vertices[a], middle;
        if (a > b || corner++ == 0) continue;
        middle = dgfemi_add_scaled(pa, (dgfem_real)(corner - 1) / (dgfem_real)corners,
                                   dgfemi_sub(mesh->vertices[b], pa));
        dgfemi_lattice_snap(&slicer->lattice, &middle);
        slicer->middle[h] = slicer->middle[slicer->twin[h]] = dgfemi_mesh_add_vertex(mesh, middle);
        if (slicer->middle[h] == DGFEM_NONE) return dgfemi_fail_memory(slicer->hooks);
    }
    return DGFEM_OK;
}

/* An edge with more than two triangles: they are paired, and the pairs are told apart. */
static dgfem_status dgfemi_slice_pair_crowd(dgfemi_slicer *slicer, int last, int count) {
    const dgfem_hooks *hooks = slicer->hooks;
    dgfemi_spoke *spokes = (dgfemi_spoke *)dgfemi_allocate(hooks, (size_t)count, sizeof(dgfemi_spoke));
    int *stack = (int *)dgfemi_allocate(hooks, (size_t)count, sizeof(int));
    dgfem_status status = DGFEM_OK;
    if (spokes && stack) {
        dgfemi_slice_sort_spokes(slicer, last, spokes, count);
        dgfemi_slice_pair_spokes(slicer, spokes, count, stack);
        status = dgfemi_slice_part_edge(slicer, last, count / 2);
    } else {
        status = dgfemi_fail_memory(hooks);
    }
    dgfemi_free(hooks, spokes);
    dgfemi_free(hooks, stack);
    return status;
}

/* Pairs half-edges: two triangles at an edge are neighbours, more are taken apart into solid corners. */
static dgfem_status dgfemi_slice_pair_edges(dgfemi_slicer *slicer) {
    const dgfemi_edge_map *map = &slicer->splitter.crossings;
    dgfem_status status = DGFEM_OK;
    size_t i;
    int h;
    for (h = 0; h < 3 * slicer->count; h++) slicer->twin[h] = slicer->middle[h] = DGFEM_NONE;
    for (i = 0; !status && i < map->size; i++) {
        int last = map->slots[i].value, count = 0;
        if (!dgfemi_edge_map_has(map, &map->slots[i])) continue;
        for (h = last; h != DGFEM_NONE; h = slicer->chain[h]) count++;
        if (count > 2) status = dgfemi_slice_pair_crowd(slicer, last, count);
        else slicer->twin[last] = slicer->chain[last], slicer->twin[slicer->chain[last]] = last;
    }
    return status;
}

/* ---- shells ---- */

/* Six times the volume between a triangle and a point. */
static double dgfemi_slice_six_volume(const dgfemi_slicer *slicer, int t, dgfem_vec3 origin) {
    const dgfem_vec3 *vertices = slicer->mesh->vertices;
    const int *v = slicer->triangles + 3 * t;
    dgfem_vec3 a = dgfemi_sub(vertices[v[0]], origin), b = dgfemi_sub(vertices[v[1]], origin);
    return (double)dgfemi_dot(a, dgfemi_cross(b, dgfemi_sub(vertices[v[2]], origin)));
}

/* Turns the whole surface. */
static void dgfemi_slice_flip(dgfemi_slicer *slicer) {
    int t;
    for (t = 0; t < slicer->count; t++) {
        int *v = slicer->triangles + 3 * t, swap = v[1];
        v[1] = v[2], v[2] = swap;
        slicer->normals[t] = dgfemi_scale(-1, slicer->normals[t]);
    }
}

/* The total volume must be positive, if only after a flip. */
static dgfem_status dgfemi_slice_check_volume(dgfemi_slicer *slicer) {
    dgfem_vec3 middle = dgfemi_add_scaled(slicer->lower, DGFEM_R(0.5), dgfemi_sub(slicer->upper, slicer->lower));
    double six = 0;
    int t;
    for (t = 0; t < slicer->count; t++) six += dgfemi_slice_six_volume(slicer, t, middle);
    slicer->volume = six / 6;
    if (!(six - six <= 0))
        return dgfemi_fail(slicer->hooks, DGFEM_ERROR_NOT_FINITE, "the surface's volume overflows");
    if (six < 0 && !slicer->desc->flip)
        return dgfemi_fail(slicer->hooks, DGFEM_ERROR_INSIDE_OUT, "the surface has volume %g", slicer->volume);
    if (!(six < 0)) return DGFEM_OK;
    slicer->volume = -slicer->volume;
    dgfemi_slice_flip(slicer);
    return dgfemi_slice_chain_edges(slicer); /* the half-edges have changed places */
}

/* Joins triangles that share edges. */
static void dgfemi_slice_find_shells(dgfemi_slicer *slicer) {
    int t, h;
    for (t = 0; t < slicer->count; t++) slicer->shell[t] = t;
    for (h = 0; h < 3 * slicer->count; h++) {
        int a = dgfemi_root(slicer->shell, h / 3), b = dgfemi_root(slicer->shell, slicer->twin[h] / 3);
        slicer->shell[a > b ? a : b] = a > b ? b : a;
    }
    for (t = 0; t < slicer->count; t++) slicer->shell[t] = dgfemi_root(slicer->shell, t);
}

/* How often the other shells wind around a point of this one. */
static double dgfemi_slice_winding(const dgfemi_slicer *slicer, int shell) {
    const dgfem_vec3 *vertices = slicer->mesh->vertices;
    dgfem_vec3 p = vertices[slicer->triangles[3 * shell]];
    double sum = 0;
    int t;
    for (t = 0; t < slicer->count; t++) {
        const int *v = slicer->triangles + 3 * t;
        if (slicer->shell[t] == shell) continue;
        sum += dgfemi_solid_angle(dgfemi_sub(vertices[v[0]], p), dgfemi_sub(vertices[v[1]], p),
                                  dgfemi_sub(vertices[v[2]], p));
    }
    return sum / 12.566370614359172; /* 4 pi */
}

/* Every shell must enclose a volume, and one of negative volume must be a void within the others. */
static dgfem_status dgfemi_slice_check_shells(dgfemi_slicer *slicer) {
    const size_t count = (size_t)slicer->count;
    double *six, *scale;
    int t;
    dgfemi_slice_find_shells(slicer);
    six = (double *)dgfemi_arena_allocate_zero(&slicer->arena, count, sizeof(double));
    scale = (double *)dgfemi_arena_allocate_zero(&slicer->arena, count, sizeof(double));
    if (!six || !scale) return dgfemi_fail_memory(slicer->hooks);
    for (t = 0; t < slicer->count; t++) {
        int shell = slicer->shell[t];
        double s = dgfemi_slice_six_volume(slicer, t, slicer->mesh->vertices[slicer->triangles[3 * shell]]);
        six[shell] += s;
        scale[shell] += fabs(s);
    }
    for (t = 0; t < slicer->count; t++) {
        if (slicer->shell[t] != t) continue;
        if (!(fabs(six[t]) > 8 * (double)DGFEM_EPSILON * scale[t]))
            return dgfemi_fail(slicer->hooks, DGFEM_ERROR_DEGENERATE, "the part at triangle %d has no volume", t);
        if (six[t] < 0 && !(dgfemi_slice_winding(slicer, t) > 0.25))
            return dgfemi_fail(slicer->hooks, DGFEM_ERROR_INSIDE_OUT,
                               "the part at triangle %d has volume %g and is no void inside another", t, six[t] / 6);
    }
    return DGFEM_OK;
}

/* ---- cutting ---- */

/* The surface as a mesh of one element, not measured. */
static dgfem_status dgfemi_slice_begin_mesh(dgfemi_slicer *slicer) {
    dgfem_mesh *mesh = slicer->mesh;
    int t, count = slicer->count;
    if (!dgfemi_mesh_reserve(mesh, 2 * count, 6 * count, 64, 6 * count, 24 * count, 12 * count))
        return dgfemi_fail_memory(slicer->hooks);
    for (t = 0; t < count; t++) {
        int loop[6], corners = 0, h;
        for (h = 3 * t; h < 3 * t + 3; h++) {
            loop[corners++] = slicer->triangles[h];
            if (slicer->middle[h] != DGFEM_NONE) loop[corners++] = slicer->middle[h];
        }
        mesh->element_faces[t] = dgfemi_mesh_add_face(mesh, dgfemi_mesh_add_loop(mesh, loop, corners), 1, 0, DGFEM_NONE, t,
                                                      slicer->normals[t]);
    }
    mesh->element_face_count = count;
    mesh->element_count = 1;
    memset(mesh->elements, 0, sizeof(dgfem_element));
    mesh->elements[0].face_count = count;
    return DGFEM_OK;
}

/* Room for the extents of all elements and so many more. 1 on success. */
static int dgfemi_slice_fit_extents(dgfemi_slicer *slicer, int extra) {
    const dgfem_mesh *mesh = slicer->mesh;
    void *low = slicer->low, *high = slicer->high;
    int ok = dgfemi_mesh_room(slicer->hooks, &low, mesh->element_count, &slicer->low_capacity, extra, sizeof(dgfem_real));
    slicer->low = (dgfem_real *)low;
    ok = ok && dgfemi_mesh_room(slicer->hooks, &high, mesh->element_count, &slicer->high_capacity, extra,
                                sizeof(dgfem_real));
    slicer->high = (dgfem_real *)high;
    return ok;
}

static void dgfemi_slice_measure_extent(dgfemi_slicer *slicer, int element) {
    const dgfem_mesh *mesh = slicer->mesh;
    const dgfem_element *e = &mesh->elements[element];
    dgfemi_splitter *s = &slicer->splitter;
    int k;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_real *extent = s->extent + 2 * (size_t)mesh->element_faces[k];
        if (extent[0] > extent[1]) dgfemi_split_measure_extent(s, mesh->element_faces[k]);
        if (k == e->face_start) slicer->low[element] = extent[0], slicer->high[element] = extent[1];
        slicer->low[element] = dgfemi_min(slicer->low[element], extent[0]);
        slicer->high[element] = dgfemi_max(slicer->high[element], extent[1]);
    }
}

/* Splits all elements that straddle one plane. */
static dgfem_status dgfemi_slice_cut_plane(dgfemi_slicer *slicer, dgfem_real plane) {
    dgfemi_splitter *s = &slicer->splitter;
    const dgfem_mesh *mesh = slicer->mesh;
    dgfem_status status;
    int e, c;
    s->low = s->high = plane;
    s->selected.count = 0;
    for (e = 0; e < mesh->element_count; e++)
        if (slicer->low[e] < plane && plane < slicer->high[e] && !dgfemi_push(slicer->hooks, &s->selected, e))
            return dgfemi_fail_memory(slicer->hooks);
    if (s->selected.count == 0) return DGFEM_OK;
    if (!dgfemi_slice_fit_extents(slicer, s->selected.count)) return dgfemi_fail_memory(slicer->hooks);
    status = dgfemi_split_straddling(s, s->selected.data, s->selected.count);
    for (c = 0; !status && c < s->child_count; c++) {
        const dgfemi_split_child *child = &s->children[c];
        if (child->side < 0) continue;
        slicer->low[child->element] = plane, slicer->high[child->element] = slicer->high[child->parent];
        slicer->high[child->parent] = plane;
    }
    return status;
}

/* The cell along one axis of an element that lies between two of its planes; the outermost cells have no end. */
static int dgfemi_slice_cell(const dgfemi_slicer *slicer, int axis, int element) {
    const dgfemi_lattice *lattice = &slicer->lattice;
    dgfem_real middle = slicer->low[element] + (slicer->high[element] - slicer->low[element]) / 2;
    dgfem_real guess = (middle - lattice->lower[axis]) / lattice->cell[axis];
    int last = lattice->cells[axis] - 1;
    int cell = guess < 1 ? 0 : guess > (dgfem_real)last ? last : (int)guess;
    while (cell > 0 && dgfemi_lattice_plane(lattice, axis, cell) > middle) cell--;
    while (cell < last && dgfemi_lattice_plane(lattice, axis, cell + 1) <= middle) cell++;
    return cell;
}

/* All planes across one axis, the middle ones first: then an element takes part in few of the cuts. */
static dgfem_status dgfemi_slice_cut_axis(dgfemi_slicer *slicer, int axis, int stride) {
    dgfem_mesh *mesh = slicer->mesh;
    dgfem_status status = DGFEM_OK;
    int cells = slicer->lattice.cells[axis], step = 1, index, e;
    if (!dgfemi_slice_fit_extents(slicer, 0) || !dgfemi_split_set_axis(&slicer->splitter, axis)) return dgfemi_fail_memory(slicer->hooks);
    for (e = 0; e < mesh->element_count; e++) dgfemi_slice_measure_extent(slicer, e);
    while (step <= (cells - 1) / 2) step *= 2;
    for (; step > 0; step /= 2)
        for (index = step; index < cells; index += 2 * step) {
            status = dgfemi_slice_cut_plane(slicer, dgfemi_lattice_plane(&slicer->lattice, axis, index));
            if (status) return status;
            if (index > INT_MAX - 2 * step) break;
        }
    for (e = 0; e < mesh->element_count; e++) mesh->elements[e].tag += stride * dgfemi_slice_cell(slicer, axis, e);
    return status;
}

static dgfem_status dgfemi_slice_cut(dgfemi_slicer *slicer) {
    const int *cells = slicer->lattice.cells;
    dgfem_status status = dgfemi_slice_cut_axis(slicer, 0, 1);
    if (!status) status = dgfemi_slice_cut_axis(slicer, 1, cells[0]);
    if (!status) status = dgfemi_slice_cut_axis(slicer, 2, cells[0] * cells[1]);
    return status;
}

/* ---- components ---- */

/* Of the components in a cell, only those that are whole shells can be voids: the others have a cap, and beyond it is
   the outside. These get no negative volume, whatever round-off says. */
static int dgfemi_slice_measure_parts(dgfemi_slicer *slicer) {
    dgfemi_parts *parts = &slicer->splitter.parts;
    int i, k;
    if (!dgfemi_parts_measure(parts)) return 0;
    for (i = 0; i < parts->count; i++) parts->parent[i] = 0; /* from here on: has a cap */
    for (k = 0; k < parts->code_count; k++)
        if (slicer->mesh->faces[parts->codes[k] / 2].element[1] != DGFEM_NONE) parts->parent[parts->component[k]] = 1;
    for (i = 0; i < parts->count; i++)
        if (parts->parent[i] && !(parts->volume[i] > 0)) parts->volume[i] = DGFEM_R(1e-37);
    return 1;
}

/* Appends the faces of one component as an element in place of its parent. */
static dgfem_status dgfemi_slice_add_element(dgfemi_slicer *slicer, int parent, int component) {
    dgfem_mesh *mesh = slicer->mesh;
    const dgfemi_parts *parts = &slicer->splitter.parts;
    dgfemi_ints *faces = &slicer->splitter.scratch_a;
    int k, element;
    faces->count = 0;
    for (k = 0; k < parts->code_count; k++)
        if (parts->component[k] == component && !dgfemi_push(slicer->hooks, faces, parts->codes[k] / 2))
            return dgfemi_fail_memory(slicer->hooks);
    element = dgfemi_mesh_add_element(mesh, faces->data, faces->count, mesh->elements[parent].tag);
    if (element == DGFEM_NONE) return dgfemi_fail_memory(slicer->hooks);
    for (k = 0; k < faces->count; k++) {
        dgfem_face *face = &mesh->faces[faces->data[k]];
        face->element[face->element[0] == parent ? 0 : 1] = element;
    }
    return DGFEM_OK;
}

/* Replaces an element by its components, which it leaves dead. */
static dgfem_status dgfemi_slice_part_element(dgfemi_slicer *slicer, int element) {
    dgfem_mesh *mesh = slicer->mesh;
    dgfemi_splitter *s = &slicer->splitter;
    dgfem_element e = mesh->elements[element];
    dgfem_status status = DGFEM_OK;
    int k, i;
    s->below.count = 0;
    for (k = e.face_start; k < e.face_start + e.face_count; k++) {
        int f = mesh->element_faces[k];
        if (!dgfemi_push(slicer->hooks, &s->below, 2 * f + (mesh->faces[f].element[0] != element)))
            return dgfemi_fail_memory(slicer->hooks);
    }
    if (!dgfemi_parts_find(&s->parts, &s->below)) return dgfemi_fail_memory(slicer->hooks);
    if (s->parts.count > 1) {
        if (!dgfemi_slice_measure_parts(slicer)) return dgfemi_fail_memory(slicer->hooks);
        status = dgfemi_parts_attach_voids(&s->parts);
    }
    for (i = 0; !status && i < s->parts.count; i++)
        if (s->parts.count == 1 || s->parts.volume[i] > 0) status = dgfemi_slice_add_element(slicer, element, i);
    mesh->elements[element].face_count = 0;
    return status;
}

typedef struct dgfemi_tagged {
    int tag, element;
} dgfemi_tagged;

static int dgfemi_tagged_compare(const void *a, const void *b) {
    const dgfemi_tagged *x = (const dgfemi_tagged *)a, *y = (const dgfemi_tagged *)b;
    if (x->tag != y->tag) return x->tag < y->tag ? -1 : 1;
    return (x->element > y->element) - (x->element < y->element);
}

/* Takes all elements apart, in the order of the grid's cells. */
static dgfem_status dgfemi_slice_part_elements(dgfemi_slicer *slicer) {
    const dgfem_mesh *mesh = slicer->mesh;
    int e, count = mesh->element_count;
    dgfemi_tagged *order = (dgfemi_tagged *)dgfemi_arena_allocate(&slicer->arena, (size_t)count, sizeof(dgfemi_tagged));
    dgfem_status status = DGFEM_OK;
    if (!order) return dgfemi_fail_memory(slicer->hooks);
    for (e = 0; e < count; e++) order[e].tag = mesh->elements[e].tag, order[e].element = e;
    qsort(order, (size_t)count, sizeof(dgfemi_tagged), dgfemi_tagged_compare);
    for (e = 0; !status && e < count; e++) status = dgfemi_slice_part_element(slicer, order[e].element);
    return status;
}

/* ---- the result ---- */

/* Merges slivers, and in any case what round-off has left without volume. */
static dgfem_status dgfemi_slice_merge(dgfemi_slicer *slicer, dgfem_slice_info *info) {
    const dgfemi_lattice *lattice = &slicer->lattice;
    dgfem_mesh *mesh = slicer->mesh;
    dgfem_real cell = lattice->cell[0] * lattice->cell[1] * lattice->cell[2];
    dgfem_real limit = dgfemi_max(slicer->desc->sliver, DGFEM_EPSILON * DGFEM_EPSILON) * cell;
    dgfem_status status = dgfem_mesh_merge_slivers(mesh, limit, &info->slivers_merged, &info->slivers_left);
    int e;
    for (e = 0; !status && e < mesh->element_count; e++)
        if (!(mesh->elements[e].volume > 0)) {
            int face = mesh->element_faces[mesh->elements[e].face_start];
            status = dgfemi_fail(slicer->hooks, DGFEM_ERROR_DEGENERATE,
                                 "cell %d: a part has volume %g (triangle %d): the surface crosses itself", mesh->elements[e].tag,
                                 (double)mesh->elements[e].volume, mesh->faces[face].tag);
        }
    return status;
}

/* Input, surface, cuts, components, measures, slivers; slicer->mesh is the result. */
static dgfem_status dgfemi_slice_run(dgfemi_slicer *slicer, dgfem_slice_info *info) {
    dgfem_status status = dgfemi_slice_read_vertices(slicer);
    if (!status) status = dgfemi_slice_read_triangles(slicer);
    if (!status) status = dgfemi_slice_set_grid(slicer);
    if (!status) status = dgfemi_slice_measure_triangles(slicer);
    if (!status) status = dgfemi_slice_chain_edges(slicer);
    if (!status) status = dgfemi_slice_check_volume(slicer);
    if (!status) status = dgfemi_slice_pair_edges(slicer);
    if (!status) status = dgfemi_slice_check_shells(slicer);
    if (!status) status = dgfemi_slice_begin_mesh(slicer);
    if (!status) status = dgfemi_slice_cut(slicer);
    if (!status) status = dgfemi_slice_part_elements(slicer);
    if (!status) status = dgfemi_mesh_compact(slicer->mesh);
    if (status) return status;
    dgfemi_mesh_measure(slicer->mesh);
    info->triangles = slicer->count;
    info->elements_raw = slicer->mesh->element_count;
    info->surface_volume = (dgfem_real)slicer->volume;
    info->surface_area = (dgfem_real)slicer->area;
    return dgfemi_slice_merge(slicer, info);
}

DGFEM_API dgfem_status dgfem_mesh_create_slices(const dgfem_slice_desc *desc, dgfem_mesh **out) {
    dgfem_slice_info info;
    dgfemi_slicer slicer;
    dgfem_status status;
    if (out) *out = NULL;
    status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (status) return status;
    if (!out) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "slice: nowhere to put the mesh");
    status = dgfemi_slice_check_desc(desc);
    if (status) return status;
    memset(&slicer, 0, sizeof slicer);
    memset(&info, 0, sizeof info);
    slicer.desc = desc;
    slicer.hooks = &desc->hooks;
    slicer.count = desc->triangle_count;
    slicer.mesh = dgfemi_mesh_new(&desc->hooks);
    if (!slicer.mesh) return dgfemi_fail_memory(&desc->hooks);
    slicer.arena = dgfemi_arena_make(&desc->hooks);
    slicer.splitter = dgfemi_splitter_make(slicer.mesh);
    slicer.splitter.lattice = &slicer.lattice;
    slicer.splitter.all = 1;
    status = dgfemi_slice_run(&slicer, &info);
    dgfemi_free(&desc->hooks, slicer.low);
    dgfemi_free(&desc->hooks, slicer.high);
    dgfemi_splitter_free(&slicer.splitter);
    dgfemi_arena_free(&slicer.arena);
    if (status) {
        dgfem_mesh_destroy(slicer.mesh);
        return status;
    }
    if (desc->info) *desc->info = info;
    *out = slicer.mesh;
    return DGFEM_OK;
}

/* ==== basis.c ===================================================================================================== */

/* The polynomial basis of an element: centred, scaled monomials ((x - c)/s)^(i,j,k), i + j + k <= degree. Evaluation,
   gradients, products by exponent, and the exact move of a polynomial to another centre and scale. */

#define DGFEM_MAX_BASIS 20 /* dgfem_monomial_count(DGFEM_MAX_DEGREE) */

/* Exponents of the monomials up to degree 3, in order. */
static const unsigned char dgfemi_exponents[DGFEM_MAX_BASIS][3] = {
    {0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {2, 0, 0}, {1, 1, 0}, {1, 0, 1}, {0, 2, 0}, {0, 1, 1}, {0, 0, 2},
    {3, 0, 0}, {2, 1, 0}, {2, 0, 1}, {1, 2, 0}, {1, 1, 1}, {1, 0, 2}, {0, 3, 0}, {0, 2, 1}, {0, 1, 2}, {0, 0, 3}};

/* Index of the product of monomials i and j. */
static int dgfemi_product_index(int i, int j) {
    const unsigned char *a = dgfemi_exponents[i], *b = dgfemi_exponents[j];
    return dgfem_monomial_index(a[0] + b[0], a[1] + b[1], a[2] + b[2]);
}

/* d/d(axis) of monomial i is (its exponent on the axis) times the monomial returned; DGFEM_NONE where it vanishes. */
static int dgfemi_derivative_index(int i, int axis) {
    int e[3];
    e[0] = dgfemi_exponents[i][0], e[1] = dgfemi_exponents[i][1], e[2] = dgfemi_exponents[i][2];
    if (e[axis] == 0) return DGFEM_NONE;
    e[axis]--;
    return dgfem_monomial_index(e[0], e[1], e[2]);
}

/* values[dgfem_monomial_count(degree)] of all monomials of (x - c)/s. */
static void dgfemi_basis_evaluate(int degree, dgfem_vec3 c, dgfem_real s, dgfem_vec3 x, dgfem_real *values) {
    dgfem_vec3 t = dgfemi_scale(1 / s, dgfemi_sub(x, c));
    values[0] = 1;
    if (degree >= 1) values[1] = t.x, values[2] = t.y, values[3] = t.z;
    for (int i = 4; i < dgfem_monomial_count(degree); i++) {
        const unsigned char *e = dgfemi_exponents[i];
        int axis = e[0] ? 0 : e[1] ? 1 : 2;
        values[i] = dgfemi_axis(t, axis) * values[dgfemi_derivative_index(i, axis)];
    }
}

/* gradients[dgfem_monomial_count(degree)] with respect to x. */
static void dgfemi_basis_gradients(int degree, dgfem_vec3 c, dgfem_real s, dgfem_vec3 x, dgfem_vec3 *gradients) {
    dgfem_real values[DGFEM_MAX_BASIS], g[3];
    dgfemi_basis_evaluate(degree, c, s, x, values);
    for (int i = 0; i < dgfem_monomial_count(degree); i++) {
        for (int axis = 0; axis < 3; axis++) {
            int lower = dgfemi_derivative_index(i, axis);
            g[axis] = lower == DGFEM_NONE ? 0 : (dgfem_real)dgfemi_exponents[i][axis] * values[lower] / s;
        }
        gradients[i] = dgfemi_vec3(g[0], g[1], g[2]);
    }
}

static dgfem_real dgfemi_binomial(int n, int k) {
    static const unsigned char rows[4][4] = {{1, 0, 0, 0}, {1, 1, 0, 0}, {1, 2, 1, 0}, {1, 3, 3, 1}};
    return (dgfem_real)rows[n][k];
}

/* The matrix t that writes each monomial about (c, s) in those about (c_new, s_new):
     N_i(x) = sum_k t[i * n + k] N'_k(x),   n = dgfem_monomial_count(degree)
   from xi = d + r xi' with d = (c_new - c)/s, r = s_new/s, by the binomial theorem on each axis. */
static void dgfemi_basis_shift(int degree, dgfem_vec3 c, dgfem_real s, dgfem_vec3 c_new, dgfem_real s_new,
                               dgfem_real *t) {
    int n = dgfem_monomial_count(degree);
    dgfem_vec3 d = dgfemi_scale(1 / s, dgfemi_sub(c_new, c));
    dgfem_real r = s_new / s, power[3][DGFEM_MAX_DEGREE + 1], scale_power[DGFEM_MAX_DEGREE + 1];
    scale_power[0] = power[0][0] = power[1][0] = power[2][0] = 1;
    for (int p = 1; p <= degree; p++) {
        scale_power[p] = scale_power[p - 1] * r;
        for (int axis = 0; axis < 3; axis++) power[axis][p] = power[axis][p - 1] * dgfemi_axis(d, axis);
    }
    for (int i = 0; i < n; i++)
        for (int k = 0; k < n; k++) {
            const unsigned char *a = dgfemi_exponents[i], *b = dgfemi_exponents[k];
            dgfem_real value = scale_power[b[0] + b[1] + b[2]];
            for (int axis = 0; axis < 3; axis++)
                value = b[axis] > a[axis] ? 0
                                          : value * dgfemi_binomial(a[axis], b[axis]) * power[axis][a[axis] - b[axis]];
            t[i * n + k] = value;
        }
}

/* ==== forms.c ===================================================================================================== */

/* The integrals behind the weak form, from moments alone, in the unrotated material. They are kept in the smallest form
   from which the rotated 3x3 blocks of warp.c follow:

     element   M_ij = int N_i N_j,   G_ij = int grad N_i grad N_j^T (3x3),   l_i = int N_i
     face      J = [N_a, -N_b] over the functions of both sides; for a held face side b is a ghost that carries the
               prescribed displacement as a polynomial about the face's centre
               P_ij  = int P[J_i] P[J_j]          the stiffly penalised part of the jump
               Q_ij  = int J_i J_j - P_ij         the rest
               q^s_ij = int J_i grad N^s_j        (vector) for both sides s: all that a traction needs, because
               traction_j(a,b) = lambda n_a q_b + mu q_a n_b + mu (n.q) delta_ab

   Functions of degree zero have no gradient, so j >= 1 in G and q. */

enum { DGFEM_CHUNK_SIZES = 32 }; /* 3 of elements, 9 of glued faces, 3 of held faces, each with or without tractions */

typedef struct dgfemi_chunks {
    size_t *data;
    int count, capacity;
} dgfemi_chunks;

/* The integrals live in chunks of one pool. Chunks have few sizes (one per degree, one per pair of degrees), so a freed
   chunk waits for the next of its size. */
typedef struct dgfemi_chunk_bin {
    size_t size;
    dgfemi_chunks free; /* offsets */
} dgfemi_chunk_bin;

typedef struct dgfemi_element_form {
    int count;   /* basis functions */
    size_t data; /* chunk: mass [count^2], load [count], stiffness [(count - 1)^2] 3x3 matrices, row-major */
} dgfemi_element_form;

typedef struct dgfemi_face_form {
    int face;
    int element[2];        /* element[1] is DGFEM_NONE on a held face */
    int count[2];          /* functions of each side; count[1] of the ghost on a held face */
    size_t data;           /* chunk: P, Q [(count[0] + count[1])^2] each, q^0, q^1 [(count[0] + count[1]) * (count[s] - 1)]
                              vectors where there are tractions, ghost [count[1]] vectors on a held face */
    dgfem_real eta_stiff;  /* eta0 p^2 g_f */
    dgfem_real eta_rest;   /* eta_r p^2 g_f */
    dgfem_real weight;     /* of the average: 1/2, on a held face 1 */
    int consistent;        /* 1: IP, 0: BZ, whose forms have no tractions */
    int normal_only;       /* held face: 1: only the component along the rest normal is held */
    int condition;         /* held face: id of the condition that holds it, else DGFEM_NONE */
} dgfemi_face_form;

struct dgfem_forms {
    dgfemi_element_form *elements;
    dgfemi_face_form *faces;
    int face_count, face_capacity;
    dgfem_real *data;
    size_t data_count, data_capacity;
    dgfemi_chunk_bin bins[DGFEM_CHUNK_SIZES];
    int bin_count;
};

static dgfem_real dgfemi_mu(const dgfem_material *m) { return m->young / (2 * (1 + m->poisson)); }
static dgfem_real dgfemi_lambda(const dgfem_material *m) {
    return m->young * m->poisson / ((1 + m->poisson) * (1 - 2 * m->poisson));
}

/* ---- where things are in a chunk ---- */

static size_t dgfemi_element_form_size(int count) {
    size_t n = (size_t)count;
    return n * n + n + 9 * (n - 1) * (n - 1);
}
static dgfem_real *dgfemi_form_mass(const dgfem_forms *forms, int element) {
    return forms->data + forms->elements[element].data;
}
static dgfem_real *dgfemi_form_load(const dgfem_forms *forms, int element) {
    size_t n = (size_t)forms->elements[element].count;
    return dgfemi_form_mass(forms, element) + n * n;
}
static dgfem_real *dgfemi_form_stiffness(const dgfem_forms *forms, int element) {
    return dgfemi_form_load(forms, element) + forms->elements[element].count;
}

static size_t dgfemi_form_sides(const dgfemi_face_form *form) { return (size_t)(form->count[0] + form->count[1]); }
static int dgfemi_form_has_traction(const dgfemi_face_form *form, int side) {
    return form->consistent && form->element[side] != DGFEM_NONE;
}
static size_t dgfemi_form_traction_size(const dgfemi_face_form *form, int side) {
    return dgfemi_form_has_traction(form, side) ? 3 * dgfemi_form_sides(form) * (size_t)(form->count[side] - 1) : 0;
}
static size_t dgfemi_face_form_size(const dgfemi_face_form *form) {
    size_t sides = dgfemi_form_sides(form);
    return 2 * sides * sides + dgfemi_form_traction_size(form, 0) + dgfemi_form_traction_size(form, 1) +
           (form->element[1] == DGFEM_NONE ? 3 * (size_t)form->count[1] : 0);
}
static dgfem_real *dgfemi_form_stiff(const dgfem_forms *forms, const dgfemi_face_form *form) {
    return forms->data + form->data;
}
static dgfem_real *dgfemi_form_rest(const dgfem_forms *forms, const dgfemi_face_form *form) {
    return dgfemi_form_stiff(forms, form) + dgfemi_form_sides(form) * dgfemi_form_sides(form);
}
static dgfem_vec3 *dgfemi_form_traction(const dgfem_forms *forms, const dgfemi_face_form *form, int side) {
    dgfem_real *first = dgfemi_form_rest(forms, form) + dgfemi_form_sides(form) * dgfemi_form_sides(form);
    return (dgfem_vec3 *)(void *)(first + (side ? dgfemi_form_traction_size(form, 0) : 0));
}
static dgfem_vec3 *dgfemi_form_ghost(const dgfem_forms *forms, const dgfemi_face_form *form) {
    return dgfemi_form_traction(forms, form, 0) + dgfemi_form_traction_size(form, 0) / 3;
}

/* ---- the pool ---- */

static dgfemi_chunk_bin *dgfemi_forms_bin(dgfem_forms *forms, size_t size) {
    for (int i = 0; i < forms->bin_count; i++)
        if (forms->bins[i].size == size) return &forms->bins[i];
    DGFEM_ASSERT(forms->bin_count < DGFEM_CHUNK_SIZES);
    forms->bins[forms->bin_count].size = size;
    return &forms->bins[forms->bin_count++];
}

/* A chunk of `size` numbers; its offset goes to *offset. 0 when out of memory. */
static int dgfemi_forms_take(dgfem_forms *forms, const dgfem_hooks *hooks, size_t size, size_t *offset) {
    dgfemi_chunk_bin *bin = dgfemi_forms_bin(forms, size);
    if (bin->free.count > 0) {
        *offset = bin->free.data[--bin->free.count];
        return 1;
    }
    if (forms->data_capacity - forms->data_count < size) {
        size_t wanted = forms->data_capacity + forms->data_capacity / 2;
        if (wanted < forms->data_count + size) wanted = forms->data_count + size;
        dgfem_real *grown = (dgfem_real *)dgfemi_reallocate(hooks, forms->data, wanted, sizeof(dgfem_real));
        if (!grown) return 0;
        forms->data = grown;
        forms->data_capacity = wanted;
    }
    *offset = forms->data_count;
    forms->data_count += size;
    return 1;
}

/* Gives a chunk back. Where the list of free ones cannot grow the chunk is lost until the forms are destroyed. */
static void dgfemi_forms_give(dgfem_forms *forms, const dgfem_hooks *hooks, size_t size, size_t offset) {
    dgfemi_chunks *chunks = &dgfemi_forms_bin(forms, size)->free;
    if (chunks->count == chunks->capacity) {
        void *grown = dgfemi_grow(hooks, chunks->data, &chunks->capacity, chunks->count + 1, sizeof(size_t));
        if (!grown) return;
        chunks->data = (size_t *)grown;
    }
    chunks->data[chunks->count++] = offset;
}

static void dgfemi_forms_destroy(dgfem_forms *forms, const dgfem_hooks *hooks) {
    if (!forms) return;
    for (int i = 0; i < forms->bin_count; i++) dgfemi_free(hooks, forms->bins[i].free.data);
    dgfemi_free(hooks, forms->elements);
    dgfemi_free(hooks, forms->faces);
    dgfemi_free(hooks, forms->data);
    dgfemi_free(hooks, forms);
}

/* ---- moments ---- */

#define DGFEM_MAX_MOMENTS 84 /* dgfem_monomial_count(DGFEM_MAX_MOMENT_DEGREE) */

static void dgfemi_moments_loops(const dgfem_mesh *mesh, const dgfem_face *face, int reverse, dgfemi_moments *moments) {
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++)
        dgfemi_moments_loop(moments, mesh->vertices, mesh->loop_vertices + mesh->loops[l].start, mesh->loops[l].count,
                            reverse);
}

/* out[i] = integral of monomial i of (x - centre)/scale over the element. */
static void dgfemi_element_moments(const dgfem_mesh *mesh, int element, int degree, dgfem_vec3 centre,
                                   dgfem_real scale, dgfem_real *out) {
    const dgfem_element *e = &mesh->elements[element];
    dgfemi_moments moments;
    dgfemi_moments_begin_volume(&moments, degree, centre, scale);
    for (int k = 0; k < e->face_count; k++) {
        int face = mesh->element_faces[e->face_start + k];
        dgfemi_moments_loops(mesh, &mesh->faces[face], dgfemi_mesh_sign(mesh, element, face) < 0, &moments);
    }
    dgfemi_moments_end(&moments, out);
}

/* The same over a face. */
static void dgfemi_mesh_face_moments(const dgfem_mesh *mesh, int face, int degree, dgfem_vec3 centre, dgfem_real scale,
                                     dgfem_real *out) {
    dgfemi_moments moments;
    dgfemi_moments_begin_face(&moments, degree, centre, scale, mesh->faces[face].normal);
    dgfemi_moments_loops(mesh, &mesh->faces[face], 0, &moments);
    dgfemi_moments_end(&moments, out);
}

/* ---- elements ---- */

/* G_ij[a][b] = int d_a N_i d_b N_j: the product of two derivatives is again one monomial, so each entry is one moment. */
static void dgfemi_element_stiffness(int count, dgfem_real scale, const dgfem_real *moments, dgfem_real *out) {
    dgfem_real inverse = 1 / (scale * scale);
    for (int i = 1; i < count; i++)
        for (int j = 1; j < count; j++)
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++, out++) {
                    int di = dgfemi_derivative_index(i, a), dj = dgfemi_derivative_index(j, b);
                    *out = 0;
                    if (di == DGFEM_NONE || dj == DGFEM_NONE) continue;
                    dgfem_real factor = (dgfem_real)(dgfemi_exponents[i][a] * dgfemi_exponents[j][b]) * inverse;
                    *out = factor * moments[dgfemi_product_index(di, dj)];
                }
}

/* The integrals of one element. 0 when out of memory. */
static int dgfemi_forms_set_element(const dgfem_body *body, dgfem_forms *forms, int element) {
    dgfemi_element_form *form = &forms->elements[element];
    int degree = body->degree[element], n = dgfem_monomial_count(degree);
    dgfem_real moments[DGFEM_MAX_MOMENTS];
    form->count = n;
    if (!dgfemi_forms_take(forms, &body->hooks, dgfemi_element_form_size(n), &form->data)) return 0;
    dgfemi_element_moments(body->mesh, element, 2 * degree, body->origin[element], body->scale[element], moments);
    dgfem_real *mass = dgfemi_form_mass(forms, element);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) mass[i * n + j] = moments[dgfemi_product_index(i, j)];
    memcpy(dgfemi_form_load(forms, element), moments, (size_t)n * sizeof(dgfem_real));
    dgfemi_element_stiffness(n, body->scale[element], moments, dgfemi_form_stiffness(forms, element));
    return 1;
}

/* ---- faces ---- */

/* Total area of the element's faces in the plane of `face` with the same outward normal. The penalty is scaled by this
   patch, not by the face, so that dividing a face changes nothing. On the boundary, a smooth surface in triangles is one
   patch too: its faces count by how far they look the same way, or the bound on eta would grow with their number. */
static dgfem_real dgfemi_patch_area(const dgfem_mesh *mesh, int element, int face) {
    const dgfem_real tolerance = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-6);
    const dgfem_element *e = &mesh->elements[element];
    const dgfem_face *f = &mesh->faces[face];
    dgfem_real area = 0, sign = (dgfem_real)dgfemi_mesh_sign(mesh, element, face);
    for (int k = 0; k < e->face_count; k++) {
        int other = mesh->element_faces[e->face_start + k];
        const dgfem_face *g = &mesh->faces[other];
        dgfem_real same = sign * (dgfem_real)dgfemi_mesh_sign(mesh, element, other);
        dgfem_real turn = same * dgfemi_dot(f->normal, g->normal);
        if (f->element[1] == DGFEM_NONE) {
            if (g->element[1] == DGFEM_NONE && turn > 0) area += turn * turn * g->area;
            continue;
        }
        if (other != face) {
            if (!(turn > 1 - tolerance)) continue;
            if (dgfemi_abs(dgfemi_dot(f->normal, dgfemi_sub(g->centre, f->centre))) > tolerance * e->radius) continue;
        }
        area += g->area;
    }
    return area;
}

/* Everything about one face in monomials about its own centre, while its integrals are computed. */
typedef struct dgfemi_face_frame {
    int degree;                 /* the larger of both sides */
    int count;                  /* monomials up to degree */
    dgfem_vec3 centre;
    dgfem_real scale;
    dgfem_vec3 axis[2];         /* in-plane principal axes, divided by the scaled radius of gyration along each */
    dgfem_real moments[DGFEM_MAX_MOMENTS]; /* scaled, up to 2 * degree */
    int sides;                  /* functions of both sides */
    dgfem_real jump[2 * DGFEM_MAX_BASIS][DGFEM_MAX_BASIS];      /* J_i in face monomials */
    dgfem_real jump_gram[2 * DGFEM_MAX_BASIS][DGFEM_MAX_BASIS]; /* int J_i m_k */
} dgfemi_face_frame;

static dgfem_real dgfemi_face_radius(const dgfem_mesh *mesh, const dgfem_face *face) {
    dgfem_real largest = 0;
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++)
        for (int k = 0; k < mesh->loops[l].count; k++) {
            dgfem_vec3 p = mesh->vertices[mesh->loop_vertices[mesh->loops[l].start + k]];
            largest = dgfemi_max(largest, dgfemi_distance(p, face->centre));
        }
    return largest;
}

/* The face's axes of inertia and extents make the projection's basis well conditioned on thin faces. */
static void dgfemi_face_axes(dgfemi_face_frame *frame, dgfem_vec3 normal) {
    const dgfem_real *m = frame->moments;
    dgfem_mat3 inertia, vectors;
    dgfem_real values[3], area = m[0];
    inertia.m[0][0] = m[4], inertia.m[1][1] = m[7], inertia.m[2][2] = m[9];
    inertia.m[0][1] = inertia.m[1][0] = m[5];
    inertia.m[0][2] = inertia.m[2][0] = m[6];
    inertia.m[1][2] = inertia.m[2][1] = m[8];
    dgfem_eigen_symmetric(inertia, values, &vectors);
    frame->axis[0] = dgfemi_column(&vectors, 2);
    frame->axis[0] = dgfemi_normalized(dgfemi_add_scaled(frame->axis[0], -dgfemi_dot(frame->axis[0], normal), normal));
    frame->axis[1] = dgfemi_cross(normal, frame->axis[0]);
    for (int k = 0; k < 2; k++) {
        dgfem_real gyration = dgfemi_sqrt(dgfemi_max(values[2 - k], 0) / area);
        if (gyration > DGFEM_EPSILON) frame->axis[k] = dgfemi_scale(1 / gyration, frame->axis[k]);
    }
}

static void dgfemi_face_side(dgfemi_face_frame *frame, int first, int degree, dgfem_vec3 origin, dgfem_real scale,
                             dgfem_real sign) {
    dgfem_real shift[DGFEM_MAX_BASIS * DGFEM_MAX_BASIS];
    int n = dgfem_monomial_count(degree);
    dgfemi_basis_shift(degree, origin, scale, frame->centre, frame->scale, shift);
    for (int i = 0; i < n; i++)
        for (int k = 0; k < frame->count; k++) frame->jump[first + i][k] = k < n ? sign * shift[i * n + k] : 0;
}

static void dgfemi_face_frame_set(const dgfem_body *body, const dgfemi_face_form *form, dgfemi_face_frame *frame) {
    const dgfem_face *face = &body->mesh->faces[form->face];
    int a = form->element[0], b = form->element[1];
    frame->degree = body->degree[a];
    if (b != DGFEM_NONE && body->degree[b] > frame->degree) frame->degree = body->degree[b];
    frame->count = dgfem_monomial_count(frame->degree);
    frame->sides = form->count[0] + form->count[1];
    frame->centre = face->centre;
    frame->scale = dgfemi_face_radius(body->mesh, face);
    dgfemi_mesh_face_moments(body->mesh, form->face, 2 * frame->degree, frame->centre, frame->scale, frame->moments);
    dgfemi_face_axes(frame, face->normal);
    dgfemi_face_side(frame, 0, body->degree[a], body->origin[a], body->scale[a], 1);
    if (b != DGFEM_NONE) dgfemi_face_side(frame, form->count[0], body->degree[b], body->origin[b], body->scale[b], -1);
    else dgfemi_face_side(frame, form->count[0], frame->degree, frame->centre, frame->scale, -1);
    for (int i = 0; i < frame->sides; i++)
        for (int k = 0; k < frame->count; k++) {
            dgfem_real sum = 0;
            for (int l = 0; l < frame->count; l++)
                sum += frame->jump[i][l] * frame->moments[dgfemi_product_index(k, l)];
            frame->jump_gram[i][k] = sum;
        }
}

/* int J_i J_j */
static void dgfemi_face_jump_products(const dgfemi_face_frame *frame, dgfem_real *out) {
    for (int i = 0; i < frame->sides; i++)
        for (int j = 0; j < frame->sides; j++) {
            dgfem_real sum = 0;
            for (int k = 0; k < frame->count; k++) sum += frame->jump_gram[i][k] * frame->jump[j][k];
            out[i * frame->sides + j] = sum;
        }
}

/* The in-plane monomials (axis0 . x)^i (axis1 . x)^j, i + j <= degree - 1, in face monomials; returns their number. */
static int dgfemi_face_projection_basis(const dgfemi_face_frame *frame, dgfem_real basis[6][DGFEM_MAX_BASIS]) {
    dgfem_real linear[2][3];
    memset(basis, 0, 6 * sizeof basis[0]);
    basis[0][0] = 1;
    if (frame->degree == 1) return 1;
    for (int k = 0; k < 2; k++) {
        linear[k][0] = frame->axis[k].x, linear[k][1] = frame->axis[k].y, linear[k][2] = frame->axis[k].z;
        for (int a = 0; a < 3; a++) basis[1 + k][1 + a] = linear[k][a];
    }
    if (frame->degree == 2) return 3;
    for (int pair = 0; pair < 3; pair++) {
        const dgfem_real *u = linear[pair == 2], *v = linear[pair != 0];
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++) basis[3 + pair][dgfemi_product_index(1 + a, 1 + b)] += u[a] * v[b];
    }
    return 6;
}

/* P_ij = R^T Gm^-1 R with R = int b J, Gm = int b b^T. Functions that a thin face cannot tell apart are dropped. */
static void dgfemi_face_projection(const dgfemi_face_frame *frame, dgfem_real *out) {
    dgfem_real basis[6][DGFEM_MAX_BASIS], r[6][2 * DGFEM_MAX_BASIS], gram[6][6];
    int count = dgfemi_face_projection_basis(frame, basis), sides = frame->sides;
    for (int m = 0; m < count; m++) {
        for (int i = 0; i < sides; i++) {
            r[m][i] = 0;
            for (int k = 0; k < frame->count; k++) r[m][i] += basis[m][k] * frame->jump_gram[i][k];
        }
        for (int l = 0; l <= m; l++) {
            gram[m][l] = 0;
            for (int k = 0; k < frame->count; k++)
                for (int j = 0; j < frame->count; j++) {
                    if (basis[m][k] == 0 || basis[l][j] == 0) continue;
                    gram[m][l] += basis[m][k] * basis[l][j] * frame->moments[dgfemi_product_index(k, j)];
                }
        }
    }
    memset(out, 0, (size_t)(sides * sides) * sizeof(dgfem_real));
    for (int m = 0; m < count; m++) { /* Cholesky by rows, r becomes L^-1 R on the way */
        dgfem_real norm = gram[m][m];
        for (int l = 0; l < m; l++) {
            for (int k = 0; k < l; k++) gram[m][l] -= gram[m][k] * gram[l][k];
            gram[m][l] = gram[l][l] > 0 ? gram[m][l] / gram[l][l] : 0;
            gram[m][m] -= gram[m][l] * gram[m][l];
        }
        if (!(gram[m][m] > 1000 * DGFEM_EPSILON * norm)) {
            gram[m][m] = 0;
            continue;
        }
        gram[m][m] = dgfemi_sqrt(gram[m][m]);
        for (int i = 0; i < sides; i++) {
            for (int l = 0; l < m; l++)
                if (gram[l][l] > 0) r[m][i] -= gram[m][l] * r[l][i];
            r[m][i] /= gram[m][m];
        }
        for (int i = 0; i < sides; i++)
            for (int j = 0; j < sides; j++) out[i * sides + j] += r[m][i] * r[m][j];
    }
}

/* q_ij = int J_i grad N_j for the functions of one side that starts at `first` with `sign` in the jump. */
static void dgfemi_face_tractions(const dgfemi_face_frame *frame, int first, int count, dgfem_real sign,
                                  dgfem_vec3 *out) {
    for (int i = 0; i < frame->sides; i++)
        for (int j = 1; j < count; j++) {
            dgfem_real q[3];
            for (int axis = 0; axis < 3; axis++) {
                q[axis] = 0;
                for (int k = 1; k < frame->count; k++) {
                    int lower = dgfemi_derivative_index(k, axis);
                    if (lower == DGFEM_NONE) continue;
                    q[axis] += (dgfem_real)dgfemi_exponents[k][axis] * frame->jump[first + j][k] *
                               frame->jump_gram[i][lower];
                }
                q[axis] *= sign / frame->scale;
            }
            *out++ = dgfemi_vec3(q[0], q[1], q[2]);
        }
}

/* g_f of the sheet: patch areas over volumes; 4 A/V on a held face, where the one side carries all. */
static dgfem_real dgfemi_face_penalty(const dgfem_mesh *mesh, const dgfemi_face_form *form) {
    const dgfem_real held = 4;
    int a = form->element[0], b = form->element[1];
    dgfem_real g = dgfemi_patch_area(mesh, a, form->face) / mesh->elements[a].volume;
    if (b == DGFEM_NONE) return held * g;
    return g + dgfemi_patch_area(mesh, b, form->face) / mesh->elements[b].volume;
}

/* Fills in the integrals of a face whose members face, element, consistent, normal_only and condition are set. 0 when
   out of memory. */
static int dgfemi_forms_set_face(const dgfem_body *body, dgfem_forms *forms, dgfemi_face_form *form) {
    dgfemi_face_frame frame;
    int a = form->element[0], b = form->element[1];
    form->count[0] = dgfem_monomial_count(body->degree[a]);
    form->count[1] = dgfem_monomial_count(body->degree[b == DGFEM_NONE ? a : b]);
    if (!dgfemi_forms_take(forms, &body->hooks, dgfemi_face_form_size(form), &form->data)) return 0;
    dgfemi_face_frame_set(body, form, &frame);
    size_t square = dgfemi_form_sides(form) * dgfemi_form_sides(form);
    dgfem_real *stiff = dgfemi_form_stiff(forms, form), *rest = dgfemi_form_rest(forms, form);
    dgfemi_face_jump_products(&frame, rest);
    if (body->desc.penalty == DGFEM_PENALTY_SPLIT) dgfemi_face_projection(&frame, stiff);
    else memcpy(stiff, rest, square * sizeof *stiff);
    for (size_t i = 0; i < square; i++) rest[i] -= stiff[i];
    for (int s = 0; s < 2; s++)
        if (dgfemi_form_has_traction(form, s))
            dgfemi_face_tractions(&frame, s ? form->count[0] : 0, form->count[s], s ? DGFEM_R(-1) : DGFEM_R(1),
                                  dgfemi_form_traction(forms, form, s));
    if (b == DGFEM_NONE)
        memset(dgfemi_form_ghost(forms, form), 0, (size_t)form->count[1] * sizeof(dgfem_vec3));
    dgfem_real penalty = dgfemi_face_penalty(body->mesh, form) * (dgfem_real)(frame.degree * frame.degree);
    form->eta_stiff = body->desc.eta * penalty;
    form->eta_rest = body->desc.eta_rest * penalty;
    form->weight = b == DGFEM_NONE ? 1 : DGFEM_R(0.5);
    return 1;
}

/* A new face form, integrals included; its index, or DGFEM_NONE when out of memory. */
static int dgfemi_forms_add_face(const dgfem_body *body, dgfem_forms *forms, int face, int condition,
                                 int normal_only) {
    const dgfem_face *f = &body->mesh->faces[face];
    dgfemi_face_form form;
    memset(&form, 0, sizeof form);
    form.face = face;
    form.element[0] = f->element[0], form.element[1] = f->element[1];
    form.consistent = body->desc.flux == DGFEM_FLUX_IP;
    form.normal_only = normal_only;
    form.condition = condition;
    if (forms->face_count == forms->face_capacity) {
        void *grown = dgfemi_grow(&body->hooks, forms->faces, &forms->face_capacity, forms->face_count + 1,
                                  sizeof *forms->faces);
        if (!grown) return DGFEM_NONE;
        forms->faces = (dgfemi_face_form *)grown;
    }
    if (!dgfemi_forms_set_face(body, forms, &form)) return DGFEM_NONE;
    forms->faces[forms->face_count] = form;
    return forms->face_count++;
}

/* Removes the face forms of a condition; the others keep their order. */
static void dgfemi_forms_remove_condition(dgfem_forms *forms, const dgfem_hooks *hooks, int condition) {
    int kept = 0;
    for (int f = 0; f < forms->face_count; f++) {
        const dgfemi_face_form *form = &forms->faces[f];
        if (form->condition == condition) dgfemi_forms_give(forms, hooks, dgfemi_face_form_size(form), form->data);
        else forms->faces[kept++] = *form;
    }
    forms->face_count = kept;
}

/* Integrals of all elements and glued faces; NULL when out of memory. */
static dgfem_forms *dgfemi_forms_create(const dgfem_body *body) {
    const dgfem_mesh *mesh = body->mesh;
    dgfem_forms *forms = (dgfem_forms *)dgfemi_allocate_zero(&body->hooks, 1, sizeof *forms);
    if (!forms) return NULL;
    int ok = 1;
    forms->elements = (dgfemi_element_form *)dgfemi_allocate(&body->hooks, (size_t)mesh->element_count,
                                                             sizeof *forms->elements);
    if (!forms->elements) ok = 0;
    for (int e = 0; ok && e < mesh->element_count; e++) ok = dgfemi_forms_set_element(body, forms, e);
    for (int f = 0; ok && f < mesh->face_count; f++)
        if (mesh->faces[f].element[1] != DGFEM_NONE && !mesh->faces[f].cut)
            ok = dgfemi_forms_add_face(body, forms, f, DGFEM_NONE, 0) != DGFEM_NONE;
    if (ok) return forms;
    dgfemi_forms_destroy(forms, &body->hooks);
    return NULL;
}

/* ---- prescribed displacements ---- */

/* Fits the prescribed field on a held face by a polynomial of the face's degree about its centre: least squares over
   lattice points of the fan triangles, exact for every polynomial of that degree. The fit lives in the plane, with the
   axes of the face, so that the normal direction does not make it singular. */
typedef struct dgfemi_face_fit {
    dgfem_vec3 centre, axis[2], normal;
    dgfem_real radius;
    int degree, count; /* in-plane monomials: 3, 6, 10 */
    dgfem_real gram[10 * 10];
    dgfem_real rhs[10 * 3];
} dgfemi_face_fit;

static void dgfemi_face_fit_basis(const dgfemi_face_fit *fit, dgfem_vec3 x, dgfem_real *values) {
    dgfem_vec3 d = dgfemi_scale(1 / fit->radius, dgfemi_sub(x, fit->centre));
    dgfem_real u = dgfemi_dot(fit->axis[0], d), v = dgfemi_dot(fit->axis[1], d);
    int k = 0;
    for (int p = 0; p <= fit->degree; p++)
        for (int i = p; i >= 0; i--) {
            values[k] = 1;
            for (int a = 0; a < i; a++) values[k] *= u;
            for (int a = 0; a < p - i; a++) values[k] *= v;
            k++;
        }
}

static void dgfemi_face_fit_sample(dgfemi_face_fit *fit, dgfem_vec3 x, dgfem_vec3 value) {
    dgfem_real b[10];
    dgfemi_face_fit_basis(fit, x, b);
    for (int i = 0; i < fit->count; i++) {
        for (int j = 0; j < fit->count; j++) fit->gram[i * fit->count + j] += b[i] * b[j];
        fit->rhs[i * 3] += b[i] * value.x;
        fit->rhs[i * 3 + 1] += b[i] * value.y;
        fit->rhs[i * 3 + 2] += b[i] * value.z;
    }
}

/* In-plane monomial u^i v^j as a polynomial in face monomials: (axis0 . m)^i (axis1 . m)^j by repeated products. */
static void dgfemi_face_fit_expand(const dgfemi_face_fit *fit, int i, int j, dgfem_real *out) {
    int factors = i + j, n = dgfem_monomial_count(factors);
    memset(out, 0, DGFEM_MAX_BASIS * sizeof *out);
    out[0] = 1;
    for (int f = 0; f < factors; f++) {
        dgfem_vec3 axis = fit->axis[f < i ? 0 : 1];
        dgfem_real next[DGFEM_MAX_BASIS];
        memset(next, 0, sizeof next);
        for (int k = 0; k < n; k++)
            for (int a = 0; a < 3 && out[k] != 0; a++)
                next[dgfemi_product_index(k, 1 + a)] += out[k] * dgfemi_axis(axis, a);
        memcpy(out, next, sizeof next);
    }
}

static void dgfemi_face_fit_frame(const dgfem_mesh *mesh, const dgfem_face *face, int degree, dgfemi_face_fit *fit) {
    memset(fit, 0, sizeof *fit);
    fit->centre = face->centre;
    fit->normal = face->normal;
    fit->radius = dgfemi_face_radius(mesh, face);
    fit->degree = degree;
    fit->count = (degree + 1) * (degree + 2) / 2;
    dgfem_vec3 n = face->normal;
    dgfem_vec3 aside = dgfemi_abs(n.x) < DGFEM_R(0.6) ? dgfemi_vec3(1, 0, 0) : dgfemi_vec3(0, 1, 0);
    fit->axis[0] = dgfemi_normalized(dgfemi_cross(n, aside));
    fit->axis[1] = dgfemi_cross(n, fit->axis[0]);
}

/* Samples the field on a lattice of every triangle (centre, p, q) of the face's loops. */
static void dgfemi_face_fit_samples(const dgfem_mesh *mesh, const dgfem_face *face, dgfemi_face_fit *fit,
                               dgfem_displacement_fn fn, void *user) {
    int steps = fit->degree + 1;
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        dgfem_loop loop = mesh->loops[l];
        for (int k = 0; k < loop.count; k++) {
            dgfem_vec3 p = mesh->vertices[mesh->loop_vertices[loop.start + k]];
            dgfem_vec3 q = mesh->vertices[mesh->loop_vertices[loop.start + (k + 1) % loop.count]];
            for (int i = 0; i <= steps; i++)
                for (int j = 0; i + j <= steps; j++) {
                    dgfem_real s = (dgfem_real)i / (dgfem_real)steps, t = (dgfem_real)j / (dgfem_real)steps;
                    dgfem_vec3 x = dgfemi_add_scaled(fit->centre, s, dgfemi_sub(p, fit->centre));
                    dgfem_vec3 value = dgfemi_vec3(0, 0, 0);
                    x = dgfemi_add_scaled(x, t, dgfemi_sub(q, fit->centre));
                    fn(user, x, &value);
                    dgfemi_face_fit_sample(fit, x, value);
                }
        }
    }
}

/* Sets the ghost of a held face to the field. DGFEM_ERROR_NOT_FINITE where the field is; a face too thin for the fit
   takes the mean. */
static dgfem_status dgfemi_forms_set_ghost(const dgfem_body *body, const dgfemi_face_form *form,
                                           dgfem_displacement_fn fn, void *user, dgfem_vec3 *ghost) {
    const dgfem_face *face = &body->mesh->faces[form->face];
    dgfemi_face_fit fit;
    dgfem_real expanded[DGFEM_MAX_BASIS];
    dgfemi_face_fit_frame(body->mesh, face, body->degree[form->element[0]], &fit);
    dgfemi_face_fit_samples(body->mesh, face, &fit, fn, user);
    for (int i = 0; i < fit.count * 3; i++)
        if (!dgfemi_is_finite(fit.rhs[i]))
            return dgfemi_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "prescribed displacement on face %d", form->face);
    dgfem_real samples = fit.gram[0];
    dgfem_vec3 mean = dgfemi_scale(1 / samples, dgfemi_vec3(fit.rhs[0], fit.rhs[1], fit.rhs[2]));
    memset(ghost, 0, (size_t)form->count[1] * sizeof *ghost);
    if (!dgfemi_cholesky_dense(fit.gram, fit.count)) {
        ghost[0] = mean;
        return DGFEM_OK;
    }
    dgfemi_cholesky_dense_solve(fit.gram, fit.count, fit.rhs, 3);
    int m = 0;
    for (int p = 0; p <= fit.degree; p++)
        for (int i = p; i >= 0; i--, m++) {
            dgfemi_face_fit_expand(&fit, i, p - i, expanded);
            dgfem_vec3 c = dgfemi_vec3(fit.rhs[3 * m], fit.rhs[3 * m + 1], fit.rhs[3 * m + 2]);
            for (int k = 0; k < form->count[1]; k++) ghost[k] = dgfemi_add_scaled(ghost[k], expanded[k], c);
        }
    return DGFEM_OK;
}

/* ==== sparse.c ==================================================================================================== */

/* Symmetric matrix in dense blocks of any sizes. Stored is the lower half, by rows of blocks. */

DGFEM_API dgfem_matrix_desc dgfem_default_matrix_desc(void) {
    dgfem_matrix_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    return desc;
}

/* ---- creation ---- */

/* Stored blocks are counted in int, and so are the two entries that each makes in the graph of blocks. */
#define DGFEM_MAX_MATRIX_BLOCKS (INT_MAX / 4)

static dgfem_status dgfemi_matrix_check_blocks(const dgfem_matrix_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    int size = 0, i;
    if (desc->block_count < 0 || (desc->block_count > 0 && !desc->block_sizes))
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "matrix: no sizes for %d blocks", desc->block_count);
    for (i = 0; i < desc->block_count; i++) {
        if (desc->block_sizes[i] < 1)
            return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "matrix: block %d has size %d", i, desc->block_sizes[i]);
        if (desc->block_sizes[i] > INT_MAX - size)
            return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "matrix: block %d makes it larger than INT_MAX", i);
        size += desc->block_sizes[i];
    }
    for (i = 0; desc->centres && i < desc->block_count; i++) {
        dgfem_vec3 c = desc->centres[i];
        if (!dgfemi_is_finite(c.x) || !dgfemi_is_finite(c.y) || !dgfemi_is_finite(c.z))
            return dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "matrix: centre of block %d", i);
    }
    return DGFEM_OK;
}

static dgfem_status dgfemi_matrix_check_pairs(const dgfem_matrix_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    int i;
    if (desc->pair_count < 0 || (desc->pair_count > 0 && !desc->pairs))
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "matrix: no data for %d pairs", desc->pair_count);
    if (desc->pair_count > DGFEM_MAX_MATRIX_BLOCKS || desc->block_count > DGFEM_MAX_MATRIX_BLOCKS - desc->pair_count)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "matrix: %d blocks and %d pairs are too many",
                           desc->block_count, desc->pair_count);
    for (i = 0; i < desc->pair_count; i++) {
        const int *pair = desc->pairs + 2 * (size_t)i;
        if (pair[0] < 0 || pair[0] >= desc->block_count || pair[1] < 0 || pair[1] >= desc->block_count)
            return dgfemi_fail(hooks, DGFEM_ERROR_INDEX, "matrix: pair %d couples blocks %d and %d of %d", i, pair[0],
                               pair[1], desc->block_count);
    }
    return DGFEM_OK;
}

/* Turns counts[i], the number of items in bucket i, into the place of the bucket's first item; counts[buckets] becomes
   the number of all. */
static void dgfemi_counts_to_starts(int *counts, int buckets) {
    int i, total = 0;
    for (i = 0; i < buckets; i++) {
        int count = counts[i];
        counts[i] = total;
        total += count;
    }
    counts[buckets] = total;
}

/* After filling, starts[i] has moved to the end of bucket i: moves all back. */
static void dgfemi_restore_starts(int *starts, int buckets) {
    int i;
    for (i = buckets; i > 0; i--) starts[i] = starts[i - 1];
    starts[0] = 0;
}

/* The pairs below the diagonal, sorted by column: row[k], starts[column] <= k < starts[column + 1]; with repeats. */
static void dgfemi_pairs_by_column(const dgfem_matrix_desc *desc, int *starts, int *row) {
    int pass, i;
    memset(starts, 0, ((size_t)desc->block_count + 1) * sizeof *starts);
    for (pass = 0; pass < 2; pass++) {
        for (i = 0; i < desc->pair_count; i++) {
            int a = desc->pairs[2 * (size_t)i], b = desc->pairs[2 * (size_t)i + 1];
            if (a == b) continue;
            if (pass == 0) starts[a < b ? a : b]++;
            else row[starts[a < b ? a : b]++] = a < b ? b : a;
        }
        if (pass == 0) dgfemi_counts_to_starts(starts, desc->block_count);
    }
    dgfemi_restore_starts(starts, desc->block_count);
}

/* Visits the columns in ascending order and appends each to its rows, the diagonal's included: so every row's columns
   ascend, and a repeat can only repeat the last one. With column NULL this counts, with it, end[r] is where the next
   column of row r goes. last[block_count] is scratch. */
static void dgfemi_append_columns(int block_count, const int *starts, const int *row, int *last, int *end,
                                  int *column) {
    int j, k;
    for (j = 0; j < block_count; j++) last[j] = DGFEM_NONE;
    for (j = 0; j < block_count; j++)
        for (k = starts[j]; k <= starts[j + 1]; k++) {
            int r = k < starts[j + 1] ? row[k] : j;
            if (last[r] == j) continue;
            last[r] = j;
            if (column) column[end[r]] = j;
            end[r]++;
        }
}

static int dgfemi_matrix_pattern(dgfem_matrix *matrix, const dgfem_matrix_desc *desc, dgfemi_arena *arena) {
    int n = desc->block_count;
    int *starts = (int *)dgfemi_arena_allocate(arena, (size_t)n + 1, sizeof(int));
    int *row = (int *)dgfemi_arena_allocate(arena, (size_t)desc->pair_count, sizeof(int));
    int *last = (int *)dgfemi_arena_allocate(arena, (size_t)n, sizeof(int));
    matrix->row_start = (int *)dgfemi_allocate_zero(&matrix->hooks, (size_t)n + 1, sizeof(int));
    if (!starts || !row || !last || !matrix->row_start) return 0;
    dgfemi_pairs_by_column(desc, starts, row);
    dgfemi_append_columns(n, starts, row, last, matrix->row_start, NULL);
    dgfemi_counts_to_starts(matrix->row_start, n);
    matrix->column = (int *)dgfemi_allocate(&matrix->hooks, (size_t)matrix->row_start[n], sizeof(int));
    if (!matrix->column) return 0;
    dgfemi_append_columns(n, starts, row, last, matrix->row_start, matrix->column);
    dgfemi_restore_starts(matrix->row_start, n);
    return 1;
}

/* total + a * b; where that is more than any array can hold, a number that no allocation accepts. */
static size_t dgfemi_add_product(size_t total, size_t a, size_t b) {
    const size_t limit = (size_t)PTRDIFF_MAX;
    return a && b > (limit - total) / a ? limit : total + a * b;
}

/* Needs the pattern. */
static int dgfemi_matrix_values(dgfem_matrix *matrix, const dgfem_matrix_desc *desc) {
    size_t total = 0;
    int stored = matrix->row_start[matrix->block_count], r, k;
    matrix->offset = (int *)dgfemi_allocate(&matrix->hooks, (size_t)matrix->block_count + 1, sizeof(int));
    matrix->value_start = (size_t *)dgfemi_allocate(&matrix->hooks, (size_t)stored + 1, sizeof(size_t));
    if (!matrix->offset || !matrix->value_start) return 0;
    for (r = 0; r < matrix->block_count; r++) {
        matrix->offset[r] = matrix->size;
        matrix->size += desc->block_sizes[r];
        for (k = matrix->row_start[r]; k < matrix->row_start[r + 1]; k++) {
            matrix->value_start[k] = total;
            total =
                dgfemi_add_product(total, (size_t)desc->block_sizes[r], (size_t)desc->block_sizes[matrix->column[k]]);
        }
    }
    matrix->offset[matrix->block_count] = matrix->size;
    matrix->value_start[stored] = total;
    matrix->values = (dgfem_real *)dgfemi_allocate_zero(&matrix->hooks, total, sizeof(dgfem_real));
    return matrix->values != NULL;
}

/* NULL when out of memory. */
static dgfem_matrix *dgfemi_matrix_build(const dgfem_matrix_desc *desc) {
    dgfemi_arena arena = dgfemi_arena_make(&desc->hooks);
    dgfem_matrix *matrix = (dgfem_matrix *)dgfemi_allocate_zero(&desc->hooks, 1, sizeof *matrix);
    int built = 0;
    if (matrix) {
        matrix->hooks = desc->hooks;
        matrix->block_count = desc->block_count;
        built = dgfemi_matrix_pattern(matrix, desc, &arena) && dgfemi_matrix_values(matrix, desc);
        if (built && desc->centres) {
            matrix->centres = (dgfem_vec3 *)dgfemi_duplicate(&desc->hooks, desc->centres, (size_t)desc->block_count,
                                                             sizeof(dgfem_vec3));
            built = matrix->centres != NULL;
        }
    }
    dgfemi_arena_free(&arena);
    if (built) return matrix;
    dgfem_matrix_destroy(matrix);
    return NULL;
}

DGFEM_API dgfem_status dgfem_matrix_create(const dgfem_matrix_desc *desc, dgfem_matrix **out) {
    dgfem_status status;
    if (out) *out = NULL;
    status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (status) return status;
    if (!out) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "matrix: out is NULL");
    status = dgfemi_matrix_check_blocks(desc);
    if (!status) status = dgfemi_matrix_check_pairs(desc);
    if (status) return status;
    *out = dgfemi_matrix_build(desc);
    return *out ? DGFEM_OK : dgfemi_fail_memory(&desc->hooks);
}

DGFEM_API void dgfem_matrix_destroy(dgfem_matrix *matrix) {
    dgfem_hooks hooks;
    if (!matrix) return;
    hooks = matrix->hooks;
    dgfemi_free(&hooks, matrix->offset);
    dgfemi_free(&hooks, matrix->row_start);
    dgfemi_free(&hooks, matrix->column);
    dgfemi_free(&hooks, matrix->value_start);
    dgfemi_free(&hooks, matrix->values);
    dgfemi_free(&hooks, matrix->centres);
    dgfemi_free(&hooks, matrix);
}

/* ---- access ---- */

static int dgfemi_block_size(const dgfem_matrix *matrix, int block) {
    return matrix->offset[block + 1] - matrix->offset[block];
}

/* Where the diagonal block of a row is stored: it is the row's last one. */
static int dgfemi_diagonal_index(const dgfem_matrix *matrix, int row) { return matrix->row_start[row + 1] - 1; }

DGFEM_API void dgfem_matrix_clear(dgfem_matrix *matrix) {
    if (!matrix) return;
    memset(matrix->values, 0, matrix->value_start[matrix->row_start[matrix->block_count]] * sizeof(dgfem_real));
}

DGFEM_API dgfem_real *dgfem_matrix_block(const dgfem_matrix *matrix, int row, int column) {
    int low, high;
    if (!matrix || row < 0 || row >= matrix->block_count || column < 0 || column > row) return NULL;
    low = matrix->row_start[row];
    high = dgfemi_diagonal_index(matrix, row);
    while (low < high) { /* the first index with column[index] >= column is in low..high */
        int middle = low + (high - low) / 2;
        if (matrix->column[middle] < column) low = middle + 1;
        else high = middle;
    }
    return matrix->column[low] == column ? matrix->values + matrix->value_start[low] : NULL;
}

/* The index of the first number that is NaN or infinite, or DGFEM_NONE. */
static int dgfemi_vector_not_finite(int count, const dgfem_real *x) {
    int i;
    for (i = 0; i < count; i++)
        if (!dgfemi_is_finite(x[i])) return i;
    return DGFEM_NONE;
}

/* ---- product ---- */

/* Both kernels treat a block in strips of 12, 3 and 1 columns: all loops over a strip have a constant length and its
   vector lives in registers. */

/* y += A x for one strip; `stride` is the length of a row of the block. */
DGFEM_INLINE void dgfemi_strip_multiply(const dgfem_real *a, int stride, int rows, int width, const dgfem_real *x,
                                        dgfem_real *y) {
    dgfem_real v[12] = {0};
    int i, j;
    for (j = 0; j < width; j++) v[j] = x[j];
    for (i = 0; i < rows; i++, a += stride) {
        dgfem_real sum[4] = {0};
        if (width == 12) {
            for (j = 0; j < 4; j++) sum[j] = a[j] * v[j] + a[j + 4] * v[j + 4] + a[j + 8] * v[j + 8];
        } else
            for (j = 0; j < width; j++) sum[j] = a[j] * v[j];
        y[i] += (sum[0] + sum[1]) + (sum[2] + sum[3]);
    }
}

/* y += A^T x for one strip. */
DGFEM_INLINE void dgfemi_strip_multiply_transposed(const dgfem_real *a, int stride, int rows, int width,
                                                   const dgfem_real *x, dgfem_real *y) {
    dgfem_real sum[12];
    int i, j;
    for (j = 0; j < width; j++) sum[j] = y[j];
    for (i = 0; i < rows; i++, a += stride)
        for (j = 0; j < width; j++) sum[j] += a[j] * x[i];
    for (j = 0; j < width; j++) y[j] = sum[j];
}

static void dgfemi_block_multiply(const dgfem_real *a, int rows, int columns, const dgfem_real *x, dgfem_real *y) {
    int j = 0;
    for (; j + 12 <= columns; j += 12) dgfemi_strip_multiply(a + j, columns, rows, 12, x + j, y);
    for (; j + 3 <= columns; j += 3) dgfemi_strip_multiply(a + j, columns, rows, 3, x + j, y);
    for (; j < columns; j++) dgfemi_strip_multiply(a + j, columns, rows, 1, x + j, y);
}

static void dgfemi_block_multiply_transposed(const dgfem_real *a, int rows, int columns, const dgfem_real *x,
                                             dgfem_real *y) {
    int j = 0;
    for (; j + 12 <= columns; j += 12) dgfemi_strip_multiply_transposed(a + j, columns, rows, 12, x, y + j);
    for (; j + 3 <= columns; j += 3) dgfemi_strip_multiply_transposed(a + j, columns, rows, 3, x, y + j);
    for (; j < columns; j++) dgfemi_strip_multiply_transposed(a + j, columns, rows, 1, x, y + j);
}

/* Every part of y receives its products in ascending order of the block that they come from: first its own row, then,
   transposed, the rows below. A loop over the parts of y in place of the rows of A, which several threads can share,
   gives therefore the same bits; it reads each block twice. */
DGFEM_API void dgfem_matrix_multiply(const dgfem_matrix *matrix, const dgfem_real *x, dgfem_real *y) {
    int r, k;
    if (!matrix || !x || !y) return;
    memset(y, 0, (size_t)matrix->size * sizeof *y);
    for (r = 0; r < matrix->block_count; r++) {
        int row = matrix->offset[r], rows = dgfemi_block_size(matrix, r);
        for (k = matrix->row_start[r]; k < matrix->row_start[r + 1]; k++) {
            const dgfem_real *block = matrix->values + matrix->value_start[k];
            int column = matrix->offset[matrix->column[k]], columns = dgfemi_block_size(matrix, matrix->column[k]);
            dgfemi_block_multiply(block, rows, columns, x + column, y + row);
            if (column != row) dgfemi_block_multiply_transposed(block, rows, columns, x + row, y + column);
        }
    }
}

/* ==== ordering.c ================================================================================================== */

/* Fill-reducing orderings of the blocks: minimum degree and geometric nested dissection. */

/* ---- graph of the blocks ---- */

/* Vertices are blocks, edges the stored blocks off the diagonal. Neighbours ascend. */
typedef struct dgfemi_graph {
    int count;
    int *start;     /* [count + 1] */
    int *neighbour; /* vertex v: start[v] <= k < start[v + 1] */
    int *block;     /* the edge's stored block in the matrix */
    int *weight;    /* [count] unknowns of the block */
} dgfemi_graph;

/* 0 when out of memory. */
static int dgfemi_graph_make(dgfemi_arena *arena, const dgfem_matrix *matrix, dgfemi_graph *graph) {
    int n = matrix->block_count, r, k;
    size_t edges = 2 * (size_t)(matrix->row_start[n] - n);
    graph->count = n;
    graph->start = (int *)dgfemi_arena_allocate_zero(arena, (size_t)n + 1, sizeof(int));
    graph->neighbour = (int *)dgfemi_arena_allocate(arena, edges, sizeof(int));
    graph->block = (int *)dgfemi_arena_allocate(arena, edges, sizeof(int));
    graph->weight = (int *)dgfemi_arena_allocate(arena, (size_t)n, sizeof(int));
    if (!graph->start || !graph->neighbour || !graph->block || !graph->weight) return 0;
    for (r = 0; r < n; r++) {
        graph->weight[r] = dgfemi_block_size(matrix, r);
        for (k = matrix->row_start[r]; k < dgfemi_diagonal_index(matrix, r); k++)
            graph->start[r]++, graph->start[matrix->column[k]]++;
    }
    dgfemi_counts_to_starts(graph->start, n);
    for (r = 0; r < n; r++)
        for (k = matrix->row_start[r]; k < dgfemi_diagonal_index(matrix, r); k++) {
            int c = matrix->column[k], at_r = graph->start[r]++, at_c = graph->start[c]++;
            graph->neighbour[at_r] = c, graph->block[at_r] = k;
            graph->neighbour[at_c] = r, graph->block[at_c] = k;
        }
    dgfemi_restore_starts(graph->start, n);
    return 1;
}

/* ---- minimum degree ---- */

/* Approximate minimum degree (Amestoy, Davis, Duff 1996) on the quotient graph. A node is a variable, not yet
   eliminated; or an element, the clique of variables that an elimination left; or dead: a variable merged into an
   indistinguishable one, an element swallowed by a later one.

   list of a variable:  its elements, then the variables that it still neighbours directly
   list of an element:  its variables */
typedef struct dgfemi_quotient {
    int count;
    const unsigned char *frozen; /* variables that count in degrees but are never eliminated; or NULL */
    int *list, *spare;           /* all lists; and as much room to pack them into */
    int used, room;              /* of list */
    int *start, *length;         /* [count] a node's list; length is DGFEM_NONE when dead */
    int *elements;               /* [count] variable: elements in its list */
    int *weight;                 /* [count] variable: of it and all that are merged into it; 0 otherwise */
    int *degree;                 /* [count] variable: bound of its neighbours' weight; element: its variables' weight */
    int64_t *mark;               /* [count] variable: == stamp when in the new element; element: see count_outside */
    int64_t stamp, stamp_step;
    int *head, *next, *previous; /* variables by degree; next also chains those of equal hash */
    int lowest;                  /* no variable has a lower degree */
    int *hash, *bucket;          /* [count] variable: hash of its list; first variable of each hash */
    int *member, *last_member;   /* [count] chain of the variables merged into one */
    int remaining;               /* weight of all variables */
    int *order, ordered;         /* the result */
} dgfemi_quotient;

static int dgfemi_quotient_allocate(dgfemi_quotient *q, dgfemi_arena *arena, const dgfemi_graph *graph) {
    int **arrays[11];
    size_t n = (size_t)graph->count;
    int edges = graph->start[graph->count], i;
    q->count = graph->count;
    q->room = edges + edges / 4 + graph->count;
    arrays[0] = &q->start, arrays[1] = &q->length, arrays[2] = &q->elements, arrays[3] = &q->weight;
    arrays[4] = &q->degree, arrays[5] = &q->next, arrays[6] = &q->previous, arrays[7] = &q->hash;
    arrays[8] = &q->bucket, arrays[9] = &q->member, arrays[10] = &q->last_member;
    for (i = 0; i < 11; i++) {
        *arrays[i] = (int *)dgfemi_arena_allocate_zero(arena, n, sizeof(int));
        if (!*arrays[i]) return 0;
    }
    q->list = (int *)dgfemi_arena_allocate(arena, (size_t)q->room, sizeof(int));
    q->spare = (int *)dgfemi_arena_allocate(arena, (size_t)q->room, sizeof(int));
    q->mark = (int64_t *)dgfemi_arena_allocate_zero(arena, n, sizeof(int64_t));
    return q->list && q->spare && q->mark;
}

static int dgfemi_is_frozen(const dgfemi_quotient *q, int i) { return q->frozen && q->frozen[i]; }

static void dgfemi_degree_insert(dgfemi_quotient *q, int i) {
    int first;
    if (dgfemi_is_frozen(q, i)) return;
    first = q->head[q->degree[i]];
    q->next[i] = first;
    q->previous[i] = DGFEM_NONE;
    if (first != DGFEM_NONE) q->previous[first] = i;
    q->head[q->degree[i]] = i;
    if (q->degree[i] < q->lowest) q->lowest = q->degree[i];
}

static void dgfemi_degree_remove(dgfemi_quotient *q, int i) {
    if (dgfemi_is_frozen(q, i)) return;
    if (q->previous[i] != DGFEM_NONE) q->next[q->previous[i]] = q->next[i];
    else q->head[q->degree[i]] = q->next[i];
    if (q->next[i] != DGFEM_NONE) q->previous[q->next[i]] = q->previous[i];
}

/* Divides the weights by their greatest common divisor: blocks of one size count as 1. Returns the total. */
static int dgfemi_quotient_weights(const dgfemi_graph *graph, int *weight) {
    int divisor = 0, total = 0, i;
    for (i = 0; i < graph->count; i++) {
        int a = graph->weight[i];
        while (a) {
            int rest = divisor % a;
            divisor = a;
            a = rest;
        }
    }
    for (i = 0; i < graph->count; i++) total += weight[i] = graph->weight[i] / divisor;
    return total;
}

/* A variable coupled to very many others would be scanned at each of their eliminations, and would fill in any order:
   it goes last and leaves the graph. */
static int dgfemi_is_dense(const dgfemi_graph *graph, int i) {
    double degree = graph->start[i + 1] - graph->start[i];
    return degree > 16 && degree > 10 * sqrt((double)graph->count);
}

static void dgfemi_quotient_fill(dgfemi_quotient *q, const dgfemi_graph *graph, int total) {
    int i, k;
    q->stamp = 1;
    q->stamp_step = (int64_t)total + 1;
    q->lowest = total;
    for (i = 0; i <= total; i++) q->head[i] = DGFEM_NONE;
    for (i = 0; i < q->count; i++) {
        q->bucket[i] = q->member[i] = DGFEM_NONE;
        q->last_member[i] = i;
        if (dgfemi_is_dense(graph, i)) q->weight[i] = 0;
        q->remaining += q->weight[i];
    }
    for (i = 0; i < q->count; i++) {
        q->start[i] = q->used;
        if (!q->weight[i]) {
            q->length[i] = DGFEM_NONE;
            continue;
        }
        for (k = graph->start[i]; k < graph->start[i + 1]; k++) {
            int j = graph->neighbour[k];
            if (!q->weight[j]) continue;
            q->list[q->used++] = j;
            q->degree[i] += q->weight[j];
        }
        q->length[i] = q->used - q->start[i];
    }
    for (i = q->count - 1; i >= 0; i--) /* equal degrees leave in ascending order */
        if (q->weight[i]) dgfemi_degree_insert(q, i);
}

/* Makes room for a list of all nodes at the end. */
static void dgfemi_quotient_pack(dgfemi_quotient *q) {
    int *packed = q->spare, used = 0, i, k;
    if (q->room - q->used >= q->count) return;
    for (i = 0; i < q->count; i++) {
        int start = q->start[i];
        q->start[i] = used;
        for (k = 0; k < q->length[i]; k++) packed[used++] = q->list[start + k];
    }
    q->spare = q->list;
    q->list = packed;
    q->used = used;
}

/* Puts a variable, and all merged into it, into the order. */
static void dgfemi_quotient_order(dgfemi_quotient *q, int i) {
    q->remaining -= q->weight[i];
    q->weight[i] = 0;
    for (; i != DGFEM_NONE; i = q->member[i]) q->order[q->ordered++] = i;
}

/* Lp = (variables next to p, directly or in one of its elements) \ p. The elements are swallowed. */
static void dgfemi_quotient_eliminate(dgfemi_quotient *q, int p) {
    int first = q->used, weight = 0, k, m;
    q->stamp += q->stamp_step;
    q->mark[p] = q->stamp;
    for (k = 0; k <= q->elements[p]; k++) {
        int whole = k < q->elements[p]; /* at last, the direct neighbours */
        int e = whole ? q->list[q->start[p] + k] : p;
        int from = whole ? q->start[e] : q->start[p] + q->elements[p];
        int length = whole ? q->length[e] : q->length[p] - q->elements[p];
        for (m = 0; m < length; m++) {
            int i = q->list[from + m];
            if (!q->weight[i] || q->mark[i] == q->stamp) continue;
            q->mark[i] = q->stamp;
            q->list[q->used++] = i;
            weight += q->weight[i];
            dgfemi_degree_remove(q, i);
        }
        q->length[e] = DGFEM_NONE;
    }
    dgfemi_quotient_order(q, p);
    q->start[p] = first;
    q->length[p] = q->used - first;
    q->degree[p] = weight;
    q->mark[p] = 0;
}

/* Afterwards mark[e] - stamp is the weight of Le \ Lp for each element e that shares a variable with Lp. */
static void dgfemi_quotient_count_outside(dgfemi_quotient *q, int p) {
    int m, k;
    for (m = 0; m < q->length[p]; m++) {
        int i = q->list[q->start[p] + m];
        for (k = 0; k < q->elements[i]; k++) {
            int e = q->list[q->start[i] + k];
            if (q->length[e] == DGFEM_NONE) continue;
            if (q->mark[e] < q->stamp) q->mark[e] = q->stamp + q->degree[e];
            q->mark[e] -= q->weight[i];
        }
    }
}

/* Rewrites the list of i, a variable of Lp: p first, then the elements that reach beyond Lp (the others are swallowed),
   then the variables outside Lp. Returns the weight of what i has beyond Lp, counted once per element. */
static int dgfemi_quotient_rewrite(dgfemi_quotient *q, int p, int i) {
    int *list = q->list + q->start[i];
    int length = q->length[i], elements = q->elements[i], kept = 0, k;
    unsigned hash = (unsigned)p;
    int64_t beyond = 0;
    for (k = 0; k < elements; k++) {
        int e = list[k];
        if (q->length[e] == DGFEM_NONE) continue;
        if (q->mark[e] == q->stamp) {
            q->length[e] = DGFEM_NONE;
            continue;
        }
        beyond += q->mark[e] - q->stamp;
        hash += (unsigned)e;
        list[kept++] = e;
    }
    q->elements[i] = kept + 1;
    for (k = elements; k < length; k++) {
        int j = list[k];
        if (!q->weight[j] || q->mark[j] == q->stamp) continue;
        beyond += q->weight[j];
        hash += (unsigned)j;
        list[kept++] = j;
    }
    /* p was the way into Lp, itself or through an element now swallowed: at least one place has become free */
    list[kept] = list[q->elements[i] - 1];
    list[q->elements[i] - 1] = list[0];
    list[0] = p;
    q->length[i] = kept + 1;
    q->hash[i] = (int)(hash % (unsigned)q->count);
    return beyond < q->remaining ? (int)beyond : q->remaining;
}

/* Same elements and same neighbours? Those of i carry the stamp. */
static int dgfemi_quotient_same(const dgfemi_quotient *q, int i, int j) {
    int k;
    if (q->length[i] != q->length[j] || q->elements[i] != q->elements[j]) return 0;
    for (k = 0; k < q->length[j]; k++)
        if (q->mark[q->list[q->start[j] + k]] != q->stamp) return 0;
    return 1;
}

/* Merges variables of Lp that have become indistinguishable: they would be eliminated one after another. */
static void dgfemi_quotient_merge(dgfemi_quotient *q, int first) {
    int i, k;
    for (i = first; i != DGFEM_NONE; i = q->next[i]) {
        int before = i, j = q->next[i];
        if (j == DGFEM_NONE) return;
        q->stamp++;
        for (k = 0; k < q->length[i]; k++) q->mark[q->list[q->start[i] + k]] = q->stamp;
        for (; j != DGFEM_NONE; j = q->next[j]) {
            if (!dgfemi_quotient_same(q, i, j)) {
                before = j;
                continue;
            }
            q->weight[i] += q->weight[j];
            q->weight[j] = 0;
            q->length[j] = DGFEM_NONE;
            q->member[q->last_member[i]] = j;
            q->last_member[i] = q->last_member[j];
            q->next[before] = q->next[j];
        }
    }
}

/* New lists and degrees for the variables of the new element p; some are eliminated with it, some merge. */
static void dgfemi_quotient_update(dgfemi_quotient *q, int p) {
    int *variables = q->list + q->start[p];
    int count = q->length[p], kept = 0, m;
    dgfemi_quotient_count_outside(q, p);
    for (m = 0; m < count; m++) {
        int i = variables[m], beyond = dgfemi_quotient_rewrite(q, p, i);
        if (dgfemi_is_frozen(q, i)) continue;
        if (beyond == 0) { /* nothing but Lp: eliminated now, it adds no fill */
            q->degree[p] -= q->weight[i];
            q->length[i] = DGFEM_NONE;
            dgfemi_quotient_order(q, i);
            continue;
        }
        if (beyond < q->degree[i]) q->degree[i] = beyond; /* for now without Lp */
        q->next[i] = q->bucket[q->hash[i]];
        q->bucket[q->hash[i]] = i;
    }
    q->stamp += q->stamp_step; /* above the marks of elements, which merging must not mistake for its own */
    for (m = 0; m < count; m++) {
        int i = variables[m], first;
        if (!q->weight[i] || dgfemi_is_frozen(q, i)) continue;
        first = q->bucket[q->hash[i]];
        q->bucket[q->hash[i]] = DGFEM_NONE;
        dgfemi_quotient_merge(q, first);
    }
    for (m = 0; m < count; m++) {
        int i = variables[m], others = q->degree[p] - q->weight[i], bound = q->remaining - q->weight[i];
        if (!q->weight[i]) continue;
        variables[kept++] = i;
        if (dgfemi_is_frozen(q, i)) continue;
        q->degree[i] = q->degree[i] < bound - others ? q->degree[i] + others : bound;
        dgfemi_degree_insert(q, i);
    }
    q->length[p] = kept;
    q->used = q->start[p] + kept;
}

/* Writes the vertices that are not frozen (frozen NULL: all) into order, from the front. Returns their number, or
   DGFEM_NONE when out of memory. */
static int dgfemi_minimum_degree(dgfemi_arena *arena, const dgfemi_graph *graph, const unsigned char *frozen,
                                 int *order) {
    dgfemi_quotient quotient, *q = &quotient;
    int total, i;
    memset(q, 0, sizeof *q);
    q->frozen = frozen;
    q->order = order;
    if (!dgfemi_quotient_allocate(q, arena, graph)) return DGFEM_NONE;
    total = dgfemi_quotient_weights(graph, q->weight);
    q->head = (int *)dgfemi_arena_allocate(arena, (size_t)total + 1, sizeof(int));
    if (!q->head) return DGFEM_NONE;
    dgfemi_quotient_fill(q, graph, total);
    for (;;) {
        int p;
        while (q->lowest < total && q->head[q->lowest] == DGFEM_NONE) q->lowest++;
        p = q->head[q->lowest];
        if (p == DGFEM_NONE) break;
        dgfemi_degree_remove(q, p);
        dgfemi_quotient_pack(q);
        dgfemi_quotient_eliminate(q, p);
        dgfemi_quotient_update(q, p);
    }
    for (i = 0; i < graph->count; i++)
        if (dgfemi_is_dense(graph, i) && !dgfemi_is_frozen(q, i)) order[q->ordered++] = i;
    return q->ordered;
}

/* ---- geometric nested dissection ---- */

/* Normals of the planes to try. Where cells touch their neighbours only across faces, as in a grid, a diagonal plane
   cuts fewer cells than one along the grid. */
#define DGFEM_DIRECTIONS 13

static dgfem_vec3 dgfemi_direction(int i) {
    static const signed char table[DGFEM_DIRECTIONS][3] = {{1, 0, 0},  {0, 1, 0},  {0, 0, 1},  {1, 1, 0},  {1, -1, 0},
                                                           {1, 0, 1},  {1, 0, -1}, {0, 1, 1},  {0, 1, -1}, {1, 1, 1},
                                                           {1, 1, -1}, {1, -1, 1}, {1, -1, -1}};
    return dgfemi_vec3((dgfem_real)table[i][0], (dgfem_real)table[i][1], (dgfem_real)table[i][2]);
}

enum {
    DGFEM_SMALLEST_PART = 48, /* vertices; smaller parts are left to minimum degree */
    DGFEM_KEY_BITS = 10       /* places along a direction are rounded to twice as many bits: ties survive round-off */
};

typedef enum dgfemi_side { DGFEM_SIDE_AHEAD, DGFEM_SIDE_PASSED, DGFEM_SIDE_SEPARATOR } dgfemi_side;

typedef struct dgfemi_dissection {
    const dgfemi_graph *graph;
    int *sorted[DGFEM_DIRECTIONS]; /* vertices by place along each direction; a part is the same range of each list */
    int *part;                     /* [count] of each vertex; DGFEM_NONE in a separator */
    int parts;                     /* made so far */
    int *degree;                   /* [count] neighbours within the part */
    int *ahead;                    /* [count] those of them that a sweep has not passed */
    unsigned char *side;           /* [count] a dgfemi_side */
    int *scratch;                  /* [count] */
    /* the network of dgfemi_narrow_separator */
    int *band, band_count;   /* its vertices */
    int *level;              /* [count] distance from the separator; DGFEM_NONE outside the band */
    unsigned char *touches;  /* [count] bit 0: the part passed, bit 1: the part ahead, both without the band */
    int *before, *after;     /* [count] neighbours on the path through a vertex, or one of the following */
    int *stack, *list;       /* [2 * count] states to go on from, all states that a search has reached */
    int *from;               /* [2 * count] the state that each was reached from */
    unsigned char *reached;  /* [2 * count] */
    unsigned char *old_side; /* [count] */
} dgfemi_dissection;

/* A sweep along a direction that stops after `passed` vertices. The separator is the layer of vertices with a neighbour
   across: the last one passed or the first one ahead. */
typedef struct dgfemi_cut {
    double cost;
    int direction, passed;
    int ahead; /* 1: the separator is the layer ahead */
} dgfemi_cut;

#define DGFEM_NO_CUT 1e300

/* Weights of the separator and of what lies to its sides. The ratio cut weighs a small separator against even halves;
   the 1 lets even halves win where nothing need be cut. */
static double dgfemi_cut_cost(double separator, double passed, double ahead) {
    double smaller = passed < ahead ? passed : ahead;
    if (16 * smaller < separator + passed + ahead) return DGFEM_NO_CUT; /* or the parts would be too many */
    return (separator + 1) / (passed * ahead);
}

/* Stable sort by one digit of the keys. */
static void dgfemi_sort_by_digit(const int *key, int shift, const int *from, int *to, int count) {
    int starts[(1 << DGFEM_KEY_BITS) + 1], mask = (1 << DGFEM_KEY_BITS) - 1, i;
    memset(starts, 0, sizeof starts);
    for (i = 0; i < count; i++) starts[(key[from[i]] >> shift) & mask]++;
    dgfemi_counts_to_starts(starts, 1 << DGFEM_KEY_BITS);
    for (i = 0; i < count; i++) to[starts[(key[from[i]] >> shift) & mask]++] = from[i];
}

/* Lists the vertices by their place along a direction, ties by index. */
static void dgfemi_sort_along(dgfemi_dissection *d, const dgfem_vec3 *points, dgfem_vec3 direction, int *sorted) {
    int n = d->graph->count, *key = d->ahead, i;
    dgfem_real low = dgfemi_dot(direction, points[0]), high = low, scale;
    for (i = 1; i < n; i++) {
        dgfem_real place = dgfemi_dot(direction, points[i]);
        low = dgfemi_min(low, place);
        high = dgfemi_max(high, place);
    }
    scale = high > low ? (dgfem_real)((1 << 2 * DGFEM_KEY_BITS) - 2) / (high - low) : 0;
    for (i = 0; i < n; i++) {
        key[i] = (int)((dgfemi_dot(direction, points[i]) - low) * scale + DGFEM_R(0.5));
        sorted[i] = i;
    }
    dgfemi_sort_by_digit(key, 0, sorted, d->scratch, n);
    dgfemi_sort_by_digit(key, DGFEM_KEY_BITS, d->scratch, sorted, n);
}

/* Moves one coordinate of the points to 0..1, halving first so that nothing overflows; then makes the typical distance
   of neighbours its unit, so that diagonal planes are diagonal to the cells also where these are flat. */
static void dgfemi_normalise_axis(const dgfemi_graph *graph, dgfem_real *x) {
    enum { STRIDE = 3 };
    dgfem_real low = x[0] / 2, high = low;
    double sum = 0, squares = 0;
    int v, k;
    for (v = 0; v < graph->count; v++) {
        low = dgfemi_min(low, x[v * STRIDE] / 2);
        high = dgfemi_max(high, x[v * STRIDE] / 2);
    }
    for (v = 0; v < graph->count; v++) x[v * STRIDE] = high > low ? (x[v * STRIDE] / 2 - low) / (high - low) : 0;
    for (v = 0; v < graph->count; v++)
        for (k = graph->start[v]; k < graph->start[v + 1]; k++) {
            double distance = fabs((double)x[v * STRIDE] - (double)x[graph->neighbour[k] * STRIDE]);
            sum += distance;
            squares += distance * distance;
        }
    if (!(squares > 1e-9 * sum)) return;
    for (v = 0; v < graph->count; v++) x[v * STRIDE] *= (dgfem_real)(sum / squares);
}

/* ---- cutting by a sweep ---- */

/* The sweep passes vertex v = sorted[at]. *last_layer and *next_layer are the weights of the two possible separators:
   passed vertices with a neighbour ahead, vertices ahead with a passed neighbour. */
static void dgfemi_sweep_past(dgfemi_dissection *d, int v, double *last_layer, double *next_layer) {
    const dgfemi_graph *graph = d->graph;
    int k;
    if (d->ahead[v] < d->degree[v]) *next_layer -= graph->weight[v];
    if (d->ahead[v] > 0) *last_layer += graph->weight[v];
    d->side[v] = DGFEM_SIDE_PASSED;
    for (k = graph->start[v]; k < graph->start[v + 1]; k++) {
        int u = graph->neighbour[k];
        if (d->part[u] != d->part[v]) continue;
        d->ahead[u]--;
        if (d->side[u] == DGFEM_SIDE_PASSED && d->ahead[u] == 0) *last_layer -= graph->weight[u];
        if (d->side[u] == DGFEM_SIDE_AHEAD && d->ahead[u] == d->degree[u] - 1) *next_layer += graph->weight[u];
    }
}

/* Improves *best by the places where a sweep along one direction may stop. */
static void dgfemi_sweep(dgfemi_dissection *d, int direction, int first, int last, double total, dgfemi_cut *best) {
    const int *sorted = d->sorted[direction];
    double passed = 0, layer[2] = {0, 0};
    int at, i;
    for (at = first; at < last; at++) {
        d->ahead[sorted[at]] = d->degree[sorted[at]];
        d->side[sorted[at]] = DGFEM_SIDE_AHEAD;
    }
    for (at = first; at < last; at++) {
        passed += d->graph->weight[sorted[at]];
        dgfemi_sweep_past(d, sorted[at], &layer[0], &layer[1]);
        for (i = 0; i < 2; i++) {
            double separator = layer[i], before = i == 0 ? passed - separator : passed;
            double cost = dgfemi_cut_cost(separator, before, total - separator - before);
            if (!(cost < best->cost)) continue;
            best->cost = cost;
            best->direction = direction;
            best->passed = at + 1 - first;
            best->ahead = i;
        }
    }
}

/* Sets the side of every vertex of the part. */
static void dgfemi_apply_cut(dgfemi_dissection *d, int first, int last, const dgfemi_cut *cut) {
    const dgfemi_graph *graph = d->graph;
    const int *sorted = d->sorted[cut->direction];
    int own = cut->ahead ? DGFEM_SIDE_AHEAD : DGFEM_SIDE_PASSED;
    int other = cut->ahead ? DGFEM_SIDE_PASSED : DGFEM_SIDE_AHEAD;
    int at, k;
    for (at = first; at < last; at++)
        d->side[sorted[at]] = at < first + cut->passed ? DGFEM_SIDE_PASSED : DGFEM_SIDE_AHEAD;
    for (at = first; at < last; at++) {
        int v = sorted[at];
        for (k = graph->start[v]; k < graph->start[v + 1] && d->side[v] == own; k++) {
            int u = graph->neighbour[k];
            if (d->part[u] == d->part[v] && d->side[u] == other) d->side[v] = DGFEM_SIDE_SEPARATOR;
        }
    }
}

/* ---- narrowing a separator ----

   A plane cuts an irregular mesh along a rough layer. Between what is left of the two sides without a band around
   that layer,

       passed | band   separator   band | ahead
              |  ---------->  path      |

   the smallest separator has as many vertices as there are disjoint paths (Menger), and stands where a search for one
   more path gets stuck. Each vertex is an arc of capacity one from its entry 2v to its exit 2v + 1. */

enum { DGFEM_PATH_ENDS = -2 }; /* in before[] and after[]: the path comes from, or goes to, the side */

/* All vertices of the part within `depth` edges of the separator. */
static void dgfemi_collect_band(dgfemi_dissection *d, int first, int last, int depth) {
    const dgfemi_graph *graph = d->graph;
    int at, k;
    d->band_count = 0;
    for (at = first; at < last; at++) {
        int v = d->sorted[0][at];
        d->level[v] = DGFEM_NONE;
        if (d->side[v] != DGFEM_SIDE_SEPARATOR) continue;
        d->level[v] = 0;
        d->band[d->band_count++] = v;
    }
    for (at = 0; at < d->band_count; at++) {
        int v = d->band[at];
        d->touches[v] = d->reached[2 * v] = d->reached[2 * v + 1] = 0;
        d->before[v] = d->after[v] = DGFEM_NONE;
        d->old_side[v] = d->side[v];
        for (k = graph->start[v]; k < graph->start[v + 1]; k++) {
            int u = graph->neighbour[k];
            if (d->part[u] != d->part[v] || d->level[u] != DGFEM_NONE) continue;
            if (d->level[v] == depth) {
                d->touches[v] |= d->side[u] == DGFEM_SIDE_PASSED ? 1 : 2;
                continue;
            }
            d->level[u] = d->level[v] + 1;
            d->band[d->band_count++] = u;
        }
    }
}

static void dgfemi_reach(dgfemi_dissection *d, int state, int from, int *stacked, int *listed) {
    if (d->reached[state]) return;
    d->reached[state] = 1;
    d->from[state] = from;
    d->stack[(*stacked)++] = d->list[(*listed)++] = state;
}

/* A depth-first search for a path from a vertex that touches the part passed; it may push other paths aside. Returns
   the exit that it leaves the band by, or DGFEM_NONE. What a vain search has reached stays marked: no later search can
   find a way out from there either. */
static int dgfemi_find_path(dgfemi_dissection *d, int source) {
    const dgfemi_graph *graph = d->graph;
    int stacked = 0, listed = 0, end = DGFEM_NONE, k;
    dgfemi_reach(d, 2 * source, DGFEM_NONE, &stacked, &listed);
    while (stacked > 0 && end == DGFEM_NONE) {
        int state = d->stack[--stacked], v = state / 2, taken = d->after[v] != DGFEM_NONE;
        if (state % 2 == 0) {
            if (!taken) dgfemi_reach(d, state + 1, state, &stacked, &listed);
            else if (d->before[v] >= 0) dgfemi_reach(d, 2 * d->before[v] + 1, state, &stacked, &listed);
            continue;
        }
        if (d->touches[v] & 2) end = state;
        if (taken) dgfemi_reach(d, state - 1, state, &stacked, &listed);
        for (k = graph->start[v]; k < graph->start[v + 1]; k++) {
            int u = graph->neighbour[k];
            if (d->part[u] == d->part[v] && d->level[u] != DGFEM_NONE) dgfemi_reach(d, 2 * u, state, &stacked, &listed);
        }
    }
    if (end != DGFEM_NONE)
        while (listed > 0) d->reached[d->list[--listed]] = 0;
    return end;
}

/* Takes the path found into the set: first unlinks the steps that it goes against, then links its own. */
static void dgfemi_take_path(dgfemi_dissection *d, int last) {
    int state, previous;
    for (state = last; (previous = d->from[state]) != DGFEM_NONE; state = previous)
        if (previous % 2 == 0 && state / 2 != previous / 2) d->after[state / 2] = d->before[previous / 2] = DGFEM_NONE;
    for (state = last; (previous = d->from[state]) != DGFEM_NONE; state = previous)
        if (previous % 2 == 1 && state / 2 != previous / 2) {
            d->after[previous / 2] = state / 2;
            d->before[state / 2] = previous / 2;
        }
    d->before[state / 2] = DGFEM_PATH_ENDS;
    d->after[last / 2] = DGFEM_PATH_ENDS;
}

/* Replaces the separator by the smallest one within the band if that costs less; 1 if so. Vertices count as one each
   here, by their weights in the cost. */
static int dgfemi_narrow_separator(dgfemi_dissection *d, int first, int last, int depth, double *cost) {
    double weight[3] = {0, 0, 0}, new_cost;
    int at, i;
    dgfemi_collect_band(d, first, last, depth);
    for (i = 0; i < d->band_count; i++) {
        int source = d->band[i], path = DGFEM_NONE;
        if (d->touches[source] & 1) path = dgfemi_find_path(d, source);
        if (path != DGFEM_NONE) dgfemi_take_path(d, path);
    }
    for (i = 0; i < d->band_count; i++) {
        int v = d->band[i];
        d->side[v] = DGFEM_SIDE_AHEAD;
        if (d->reached[2 * v] || (d->touches[v] & 1))
            d->side[v] = d->reached[2 * v + 1] ? DGFEM_SIDE_PASSED : DGFEM_SIDE_SEPARATOR;
    }
    for (at = first; at < last; at++) weight[d->side[d->sorted[0][at]]] += d->graph->weight[d->sorted[0][at]];
    new_cost = dgfemi_cut_cost(weight[DGFEM_SIDE_SEPARATOR], weight[DGFEM_SIDE_PASSED], weight[DGFEM_SIDE_AHEAD]);
    if (new_cost < *cost) {
        *cost = new_cost;
        return 1;
    }
    for (i = 0; i < d->band_count; i++) d->side[d->band[i]] = d->old_side[d->band[i]];
    return 0;
}

/* ---- the recursion ---- */

static int dgfemi_dissection_allocate(dgfemi_dissection *d, dgfemi_arena *arena) {
    int **arrays[DGFEM_DIRECTIONS + 11];
    size_t n = (size_t)d->graph->count;
    int count = 0, i;
    for (i = 0; i < DGFEM_DIRECTIONS; i++) arrays[count++] = &d->sorted[i];
    arrays[count++] = &d->part, arrays[count++] = &d->degree, arrays[count++] = &d->ahead;
    arrays[count++] = &d->scratch, arrays[count++] = &d->band, arrays[count++] = &d->level;
    arrays[count++] = &d->before, arrays[count++] = &d->after;
    arrays[count++] = &d->stack, arrays[count++] = &d->list, arrays[count++] = &d->from; /* twice as long */
    for (i = 0; i < count; i++) {
        *arrays[i] = (int *)dgfemi_arena_allocate_zero(arena, i < count - 3 ? n : 2 * n, sizeof(int));
        if (!*arrays[i]) return 0;
    }
    d->side = (unsigned char *)dgfemi_arena_allocate(arena, n, 1);
    d->old_side = (unsigned char *)dgfemi_arena_allocate(arena, n, 1);
    d->touches = (unsigned char *)dgfemi_arena_allocate(arena, n, 1);
    d->reached = (unsigned char *)dgfemi_arena_allocate(arena, 2 * n, 1);
    return d->side && d->old_side && d->touches && d->reached;
}

/* Lists the vertices along all directions. 0 when out of memory. */
static int dgfemi_dissection_sort(dgfemi_dissection *d, dgfemi_arena *arena, const dgfem_vec3 *centres) {
    size_t bytes = (size_t)d->graph->count * sizeof(dgfem_vec3);
    dgfem_vec3 *points = (dgfem_vec3 *)dgfemi_arena_allocate(arena, bytes, 1);
    int i;
    if (!points) return 0;
    memcpy(points, centres, bytes);
    dgfemi_normalise_axis(d->graph, &points->x);
    dgfemi_normalise_axis(d->graph, &points->y);
    dgfemi_normalise_axis(d->graph, &points->z);
    for (i = 0; i < DGFEM_DIRECTIONS; i++) dgfemi_sort_along(d, points, dgfemi_direction(i), d->sorted[i]);
    return 1;
}

/* Counts the neighbours within the part. Returns its weight, 0 when it has no edges. */
static double dgfemi_part_degrees(dgfemi_dissection *d, int first, int last) {
    const dgfemi_graph *graph = d->graph;
    double total = 0;
    int edges = 0, at, k;
    for (at = first; at < last; at++) {
        int v = d->sorted[0][at];
        d->degree[v] = 0;
        for (k = graph->start[v]; k < graph->start[v + 1]; k++)
            d->degree[v] += d->part[graph->neighbour[k]] == d->part[v];
        edges += d->degree[v];
        total += graph->weight[v];
    }
    return edges ? total : 0;
}

/* Sorts the range of a list by side, otherwise in its order. */
static void dgfemi_split_list(dgfemi_dissection *d, int *list, int count, const int sizes[3]) {
    int place[3], i;
    place[0] = 0, place[1] = sizes[0], place[2] = sizes[0] + sizes[1];
    for (i = 0; i < count; i++) d->scratch[place[d->side[list[i]]]++] = list[i];
    memcpy(list, d->scratch, (size_t)count * sizeof *list);
}

/* Splits a part into one ahead, one passed and a separator, in this order; `sizes` are theirs. 0 where no cut is worth
   while, as when all places are equal or everything is coupled to everything. */
static int dgfemi_dissect(dgfemi_dissection *d, int first, int last, int sizes[3]) {
    double total = dgfemi_part_degrees(d, first, last);
    dgfemi_cut best;
    int i, at;
    if (!(total > 0)) return 0;
    memset(&best, 0, sizeof best);
    best.cost = DGFEM_NO_CUT;
    for (i = 0; i < DGFEM_DIRECTIONS; i++) dgfemi_sweep(d, i, first, last, total, &best);
    if (!(best.cost < DGFEM_NO_CUT)) return 0;
    dgfemi_apply_cut(d, first, last, &best);
    for (i = 0; i < 4; i++) /* twice in a band that follows the cut closely, then twice in a wider one */
        if (!dgfemi_narrow_separator(d, first, last, 1 + i / 2, &best.cost)) break;
    sizes[0] = sizes[1] = sizes[2] = 0;
    for (at = first; at < last; at++) {
        int v = d->sorted[0][at];
        d->part[v] = d->side[v] == DGFEM_SIDE_SEPARATOR ? DGFEM_NONE : d->parts + d->side[v];
        sizes[d->side[v]]++;
    }
    for (i = 0; i < DGFEM_DIRECTIONS; i++) dgfemi_split_list(d, d->sorted[i] + first, last - first, sizes);
    d->parts += 2;
    return 1;
}

/* Separators go behind the two parts that they separate (George 1973); the order within the smallest parts is by
   minimum degree, which sees the separators around them. 0 when out of memory. */
static int dgfemi_nested_dissection(dgfemi_arena *arena, const dgfemi_graph *graph, const dgfem_vec3 *centres,
                                    int *order) {
    dgfemi_dissection dissection, *d = &dissection;
    int n = graph->count, top = 0, ordered = n, i;
    int *stack; /* first and last of the parts still to be cut: disjoint, and none is smaller than the smallest */
    unsigned char *frozen = (unsigned char *)dgfemi_arena_allocate_zero(arena, (size_t)n, 1);
    memset(d, 0, sizeof *d);
    d->graph = graph;
    d->parts = 1;
    stack = (int *)dgfemi_arena_allocate(arena, 2 * ((size_t)n / DGFEM_SMALLEST_PART + 1), sizeof(int));
    if (!frozen || !stack || !dgfemi_dissection_allocate(d, arena) || !dgfemi_dissection_sort(d, arena, centres))
        return 0;
    if (n >= DGFEM_SMALLEST_PART) stack[top++] = 0, stack[top++] = n;
    while (top > 0) {
        int last = stack[--top], first = stack[--top], sizes[3];
        if (!dgfemi_dissect(d, first, last, sizes)) continue;
        for (i = last - sizes[DGFEM_SIDE_SEPARATOR]; i < last; i++) {
            order[--ordered] = d->sorted[0][i];
            frozen[d->sorted[0][i]] = 1;
        }
        for (i = 0; i < 2; first += sizes[i++])
            if (sizes[i] >= DGFEM_SMALLEST_PART) stack[top++] = first, stack[top++] = first + sizes[i];
    }
    return dgfemi_minimum_degree(arena, graph, frozen, order) == ordered;
}

/* ---- elimination tree ---- */

/* position[order[k]] = k; parent[k] is the position of the first row below the diagonal in column k of L (Liu 1990).
   ancestor[count] is scratch: paths already walked, shortened. */
static void dgfemi_elimination_tree(const dgfemi_graph *graph, const int *order, int *position, int *parent,
                                    int *ancestor) {
    int i, k;
    for (i = 0; i < graph->count; i++) position[order[i]] = i;
    for (i = 0; i < graph->count; i++) {
        int v = order[i];
        parent[i] = ancestor[i] = DGFEM_NONE;
        for (k = graph->start[v]; k < graph->start[v + 1]; k++) {
            int j = position[graph->neighbour[k]];
            while (j != DGFEM_NONE && j < i) {
                int next = ancestor[j];
                ancestor[j] = i;
                if (next == DGFEM_NONE) parent[j] = i;
                j = next;
            }
        }
    }
}

/* below[k], the unknowns below the diagonal block in block column k of L, and below_blocks[k] (may be NULL) their
   blocks: row i of L reaches the columns on the way from its neighbours in A up the tree to i. mark[count] is
   scratch. */
static void dgfemi_column_counts(const dgfemi_graph *graph, const int *order, const int *position, const int *parent,
                                 int *mark, int *below, int *below_blocks) {
    int i, k;
    for (i = 0; i < graph->count; i++) {
        int v = order[i];
        mark[i] = i;
        below[i] = 0;
        if (below_blocks) below_blocks[i] = 0;
        for (k = graph->start[v]; k < graph->start[v + 1]; k++) {
            int j = position[graph->neighbour[k]];
            for (; j < i && mark[j] != i; j = parent[j]) {
                mark[j] = i;
                below[j] += graph->weight[v];
                if (below_blocks) below_blocks[j]++;
            }
        }
    }
}

/* Numbers in L and multiplications and additions of the factorization: sums of c and c^2 over the counts c of all
   columns, diagonal included. */
static void dgfemi_factor_cost(const dgfemi_graph *graph, const int *order, const int *below, double *entries,
                               double *flops) {
    int k, j;
    *entries = *flops = 0;
    for (k = 0; k < graph->count; k++)
        for (j = 1; j <= graph->weight[order[k]]; j++) {
            double count = (double)below[k] + j;
            *entries += count;
            *flops += count * count;
        }
}

/* ---- choice ---- */

/* 0 when out of memory. */
static int dgfemi_order_flops(dgfemi_arena *arena, const dgfemi_graph *graph, const int *order, double *flops) {
    size_t n = (size_t)graph->count;
    int *position = (int *)dgfemi_arena_allocate(arena, n, sizeof(int));
    int *parent = (int *)dgfemi_arena_allocate(arena, n, sizeof(int));
    int *mark = (int *)dgfemi_arena_allocate(arena, n, sizeof(int));
    int *below = (int *)dgfemi_arena_allocate(arena, n, sizeof(int));
    double entries;
    if (!position || !parent || !mark || !below) return 0;
    dgfemi_elimination_tree(graph, order, position, parent, mark);
    dgfemi_column_counts(graph, order, position, parent, mark, below, NULL);
    dgfemi_factor_cost(graph, order, below, &entries, flops);
    return 1;
}

/* Nested dissection where there are centres, unless minimum degree needs less work. */
static int dgfemi_order_best(dgfemi_arena *arena, const dgfemi_graph *graph, const dgfem_vec3 *centres, int *order) {
    double flops, flops_dissection;
    int *dissection;
    if (dgfemi_minimum_degree(arena, graph, NULL, order) == DGFEM_NONE) return 0;
    if (!centres || graph->count < DGFEM_SMALLEST_PART) return 1;
    dissection = (int *)dgfemi_arena_allocate(arena, (size_t)graph->count, sizeof(int));
    if (!dissection || !dgfemi_nested_dissection(arena, graph, centres, dissection)) return 0;
    if (!dgfemi_order_flops(arena, graph, order, &flops)) return 0;
    if (!dgfemi_order_flops(arena, graph, dissection, &flops_dissection)) return 0;
    if (flops_dissection < flops) memcpy(order, dissection, (size_t)graph->count * sizeof *order);
    return 1;
}

/* order[k] is the block to eliminate as the k-th. Nested dissection needs centres. 0 when out of memory. */
static int dgfemi_order_blocks(dgfemi_arena *arena, const dgfemi_graph *graph, const dgfem_vec3 *centres,
                               dgfem_ordering ordering, int *order) {
    int i;
    if (graph->count == 0) return 1;
    switch (ordering) {
    case DGFEM_ORDERING_NATURAL:
        for (i = 0; i < graph->count; i++) order[i] = i;
        return 1;
    case DGFEM_ORDERING_MINIMUM_DEGREE: return dgfemi_minimum_degree(arena, graph, NULL, order) != DGFEM_NONE;
    case DGFEM_ORDERING_NESTED_DISSECTION:
        DGFEM_ASSERT(centres);
        return dgfemi_nested_dissection(arena, graph, centres, order);
    case DGFEM_ORDERING_AUTO: break;
    }
    return dgfemi_order_best(arena, graph, centres, order);
}

/* ==== panel.c ===================================================================================================== */

/* Dense kernels of the sparse Cholesky factorization. A panel is what one supernode has of L: a lower triangle D over a
   rectangle B, of the same columns.

   It is stored in strips of DGFEM_STRIP rows, first those of D, then those of B, each padded with rows of zeros to whole
   strips. A strip holds one column after the other: element (r, k) is strip[k * DGFEM_STRIP + r]. So the operands of
   every product come in the order in which the innermost kernel reads them. D's diagonal holds the reciprocals of
   L's. */

#ifndef DGFEM_STRIP
#if DGFEM_REAL_IS_FLOAT || defined(__AVX__)
#define DGFEM_STRIP 8
#else
#define DGFEM_STRIP 4
#endif
#endif

enum {
    DGFEM_TILE = 4,            /* columns of a tile, which has the rows of a strip; divides DGFEM_STRIP */
    DGFEM_PANEL_COLUMNS = 256, /* columns that are factored before they update the rest; whole strips */
    DGFEM_UPDATE_COLUMNS = 128 /* columns that are updated together: their strips stay in cache; whole strips */
};

/* ---- tiles ---- */

static int dgfemi_strips(int rows) { return rows / DGFEM_STRIP + (rows % DGFEM_STRIP != 0); }

/* sum[c][r] = sum over k of a(r, k) b(c, k): the kernel that does nearly all the work. a and b point into strips. */
static void dgfemi_tile_product(const dgfem_real *a, const dgfem_real *b, int count,
                                dgfem_real sum[DGFEM_TILE * DGFEM_STRIP]) {
    dgfem_real s0[DGFEM_STRIP], s1[DGFEM_STRIP], s2[DGFEM_STRIP], s3[DGFEM_STRIP];
    int r;
    for (r = 0; r < DGFEM_STRIP; r++) s0[r] = s1[r] = s2[r] = s3[r] = 0;
    for (; count > 0; count--, a += DGFEM_STRIP, b += DGFEM_STRIP) {
        dgfem_real b0 = b[0], b1 = b[1], b2 = b[2], b3 = b[3];
        for (r = 0; r < DGFEM_STRIP; r++) {
            dgfem_real x = a[r];
            s0[r] += x * b0;
            s1[r] += x * b1;
            s2[r] += x * b2;
            s3[r] += x * b3;
        }
    }
    for (r = 0; r < DGFEM_STRIP; r++) {
        sum[r] = s0[r];
        sum[DGFEM_STRIP + r] = s1[r];
        sum[2 * DGFEM_STRIP + r] = s2[r];
        sum[3 * DGFEM_STRIP + r] = s3[r];
    }
}

/* x -= a b^T for a tile of `columns` columns. */
static void dgfemi_tile_subtract(const dgfem_real *a, const dgfem_real *b, int count, dgfem_real *x, int columns) {
    dgfem_real sum[DGFEM_TILE * DGFEM_STRIP];
    int i;
    if (count == 0) return;
    dgfemi_tile_product(a, b, count, sum);
    for (i = 0; i < columns * DGFEM_STRIP; i++) x[i] -= sum[i];
}

/* A pivot that round-off has left of the diagonal element of A carries no digit: such a matrix is singular to working
   precision, and the pivot counts as not positive. */
#define DGFEM_PIVOT_THRESHOLD ((dgfem_real)(8 * DGFEM_EPSILON))

/* Cholesky of the square part of a tile on the diagonal, whose first column is row `offset` of the strip; solves for
   the rows below. Returns the column whose pivot fails, or DGFEM_NONE. */
static int dgfemi_tile_cholesky(dgfem_real *x, int columns, int offset, const dgfem_real *diagonal) {
    int c, d, r;
    for (c = 0; c < columns; c++) {
        dgfem_real *xc = x + c * DGFEM_STRIP;
        dgfem_real pivot = xc[offset + c], reciprocal;
        if (!(pivot > DGFEM_PIVOT_THRESHOLD * dgfemi_abs(diagonal[c])) || !dgfemi_is_finite(pivot)) return c;
        reciprocal = 1 / dgfemi_sqrt(pivot);
        for (r = 0; r < DGFEM_STRIP; r++) xc[r] = r < offset + c ? 0 : xc[r] * reciprocal;
        for (d = c + 1; d < columns; d++) {
            dgfem_real factor = xc[offset + d];
            for (r = 0; r < DGFEM_STRIP; r++) x[d * DGFEM_STRIP + r] -= factor * xc[r];
        }
        xc[offset + c] = reciprocal;
    }
    return DGFEM_NONE;
}

/* x = x T^-T, T the square part of a tile on the diagonal. */
static void dgfemi_tile_solve(dgfem_real *x, int columns, const dgfem_real *t) {
    int c, d, r;
    for (c = 0; c < columns; c++) {
        dgfem_real *xc = x + c * DGFEM_STRIP;
        for (r = 0; r < DGFEM_STRIP; r++) xc[r] *= t[c * DGFEM_STRIP + c];
        for (d = c + 1; d < columns; d++) {
            dgfem_real factor = t[c * DGFEM_STRIP + d];
            for (r = 0; r < DGFEM_STRIP; r++) x[d * DGFEM_STRIP + r] -= factor * xc[r];
        }
    }
}

/* ---- panels ---- */

typedef struct dgfemi_panel {
    dgfem_real *values;
    int width, height;
} dgfemi_panel;

static int dgfemi_panel_strips(const dgfemi_panel *p) { return dgfemi_strips(p->width) + dgfemi_strips(p->height); }

static dgfem_real *dgfemi_strip(const dgfemi_panel *p, int strip) {
    return p->values + (size_t)strip * DGFEM_STRIP * (size_t)p->width;
}

/* Row `row` of D, from column `column` on: the second operand of a product. */
static const dgfem_real *dgfemi_pivot_row(const dgfemi_panel *p, int row, int column) {
    return dgfemi_strip(p, row / DGFEM_STRIP) + (size_t)column * DGFEM_STRIP + row % DGFEM_STRIP;
}

/* The column that a strip's columns end before: those of D end at the diagonal. */
static int dgfemi_strip_end(const dgfemi_panel *p, int strip, int limit) {
    int end = strip < dgfemi_strips(p->width) ? (strip + 1) * DGFEM_STRIP : p->width;
    if (end > p->width) end = p->width;
    return end < limit ? end : limit;
}

static int dgfemi_tile_columns(int column, int end) { return end - column < DGFEM_TILE ? end - column : DGFEM_TILE; }

/* ---- factorization ---- */

/* Columns from <= k < to of one strip of L, those before `from` being done with. The rows of D that they meet are
   finished. Returns the column whose pivot fails, or DGFEM_NONE. */
static int dgfemi_factor_strip(const dgfemi_panel *p, int strip, int from, int to, const dgfem_real *diagonal) {
    dgfem_real *values = dgfemi_strip(p, strip);
    int end = dgfemi_strip_end(p, strip, to), j;
    for (j = from; j < end; j += DGFEM_TILE) {
        dgfem_real *x = values + (size_t)j * DGFEM_STRIP;
        int columns = dgfemi_tile_columns(j, end);
        dgfemi_tile_subtract(values + (size_t)from * DGFEM_STRIP, dgfemi_pivot_row(p, j, from), j - from, x, columns);
        if (strip == j / DGFEM_STRIP) {
            int failed = dgfemi_tile_cholesky(x, columns, j % DGFEM_STRIP, diagonal + j);
            if (failed != DGFEM_NONE) return j + failed;
        } else dgfemi_tile_solve(x, columns, dgfemi_pivot_row(p, j, j));
    }
    return DGFEM_NONE;
}

/* Subtracts from the columns from `to` on what the columns from <= k < to contribute. */
static void dgfemi_update_panel(const dgfemi_panel *p, int from, int to) {
    int strips = dgfemi_panel_strips(p), chunk, strip, j;
    for (chunk = to; chunk < p->width; chunk += DGFEM_UPDATE_COLUMNS)
        for (strip = chunk / DGFEM_STRIP; strip < strips; strip++) {
            dgfem_real *values = dgfemi_strip(p, strip);
            int end = dgfemi_strip_end(p, strip, chunk + DGFEM_UPDATE_COLUMNS);
            for (j = chunk; j < end; j += DGFEM_TILE)
                dgfemi_tile_subtract(values + (size_t)from * DGFEM_STRIP, dgfemi_pivot_row(p, j, from), to - from,
                                     values + (size_t)j * DGFEM_STRIP, dgfemi_tile_columns(j, end));
        }
}

/* D = L L^T, B = B L^-T. Returns the column whose pivot fails, or DGFEM_NONE. */
static int dgfemi_factor_panel(const dgfemi_panel *p, const dgfem_real *diagonal) {
    int strips = dgfemi_panel_strips(p), from, strip;
    for (from = 0; from < p->width; from += DGFEM_PANEL_COLUMNS) {
        int to = p->width - from < DGFEM_PANEL_COLUMNS ? p->width : from + DGFEM_PANEL_COLUMNS;
        for (strip = from / DGFEM_STRIP; strip < strips; strip++) {
            int failed = dgfemi_factor_strip(p, strip, from, to, diagonal);
            if (failed != DGFEM_NONE) return failed;
        }
        dgfemi_update_panel(p, from, to);
    }
    return DGFEM_NONE;
}

/* Element (i, j), i >= j, of a packed lower half with n rows is [dgfemi_packed(n, j) + i]. */
static size_t dgfemi_packed(int n, int j) { return (size_t)j * (size_t)(2 * (ptrdiff_t)n - j - 1) / 2; }

/* Element (i, j) of U, with i the tile's row: = or += -sum. */
static void dgfemi_store_tile(dgfem_real *u, int height, int row, int column, const dgfem_real *sum, int add) {
    int columns = dgfemi_tile_columns(column, height), rows = height - row < DGFEM_STRIP ? height - row : DGFEM_STRIP;
    int c, r;
    for (c = 0; c < columns; c++, sum += DGFEM_STRIP) {
        dgfem_real *to = u + dgfemi_packed(height, column + c) + row;
        int first = column + c > row ? column + c - row : 0;
        if (first == 0 && rows == DGFEM_STRIP) {
            if (add)
                for (r = 0; r < DGFEM_STRIP; r++) to[r] -= sum[r];
            else
                for (r = 0; r < DGFEM_STRIP; r++) to[r] = -sum[r];
        } else
            for (r = first; r < rows; r++) to[r] = (add ? to[r] : 0) - sum[r];
    }
}

/* U = -B B^T, lower half. */
static void dgfemi_make_update(const dgfemi_panel *p, dgfem_real *u) {
    int pivot_strips = dgfemi_strips(p->width), strips = dgfemi_strips(p->height), from, chunk, strip, j;
    dgfem_real sum[DGFEM_TILE * DGFEM_STRIP];
    for (from = 0; from < p->width; from += DGFEM_PANEL_COLUMNS) {
        int count = p->width - from < DGFEM_PANEL_COLUMNS ? p->width - from : DGFEM_PANEL_COLUMNS;
        for (chunk = 0; chunk < p->height; chunk += DGFEM_UPDATE_COLUMNS)
            for (strip = chunk / DGFEM_STRIP; strip < strips; strip++) {
                const dgfem_real *a = dgfemi_strip(p, pivot_strips + strip) + (size_t)from * DGFEM_STRIP;
                int end = (strip + 1) * DGFEM_STRIP;
                if (end > chunk + DGFEM_UPDATE_COLUMNS) end = chunk + DGFEM_UPDATE_COLUMNS;
                if (end > p->height) end = p->height;
                for (j = chunk; j < end; j += DGFEM_TILE) {
                    const dgfem_real *b = dgfemi_pivot_row(p, pivot_strips * DGFEM_STRIP + j, from);
                    dgfemi_tile_product(a, b, count, sum);
                    dgfemi_store_tile(u, p->height, strip * DGFEM_STRIP, j, sum, from > 0);
                }
            }
    }
}

/* Fills the strips from a column-major array of width + height rows; what lies above D's diagonal strips is never
   used. */
static void dgfemi_pack_panel(const dgfemi_panel *p, const dgfem_real *columns) {
    int pivot_strips = dgfemi_strips(p->width), strips = dgfemi_panel_strips(p), strip, k, r;
    size_t stride = (size_t)p->width + (size_t)p->height;
    for (strip = 0; strip < strips; strip++) {
        dgfem_real *to = dgfemi_strip(p, strip);
        int below = strip >= pivot_strips;
        int row = below ? (strip - pivot_strips) * DGFEM_STRIP : strip * DGFEM_STRIP;
        int rows = (below ? p->height : p->width) - row, end = dgfemi_strip_end(p, strip, p->width);
        const dgfem_real *from = columns + (below ? p->width + row : row);
        for (k = 0; k < end; k++, from += stride, to += DGFEM_STRIP) {
            if (rows >= DGFEM_STRIP)
                for (r = 0; r < DGFEM_STRIP; r++) to[r] = from[r];
            else
                for (r = 0; r < DGFEM_STRIP; r++) to[r] = r < rows ? from[r] : 0;
        }
    }
}

/* ---- solves ---- */

/* y += x */
static void dgfemi_add_vector(dgfem_real *y, const dgfem_real *x, int count) {
    dgfem_real sum[4];
    int i = 0, k;
    for (; i + 4 <= count; i += 4) {
        for (k = 0; k < 4; k++) sum[k] = y[i + k] + x[i + k];
        for (k = 0; k < 4; k++) y[i + k] = sum[k];
    }
    for (; i < count; i++) y[i] += x[i];
}

/* sum[r] -= sum over k of strip(r, k) x[k] */
static void dgfemi_strip_subtract(const dgfem_real *strip, int columns, const dgfem_real *x,
                                  dgfem_real sum[DGFEM_STRIP]) {
    dgfem_real even[DGFEM_STRIP] = {0}, odd[DGFEM_STRIP] = {0};
    int k = 0, r;
    for (; k + 2 <= columns; k += 2, strip += 2 * DGFEM_STRIP) {
        dgfem_real x0 = x[k], x1 = x[k + 1];
        for (r = 0; r < DGFEM_STRIP; r++) {
            even[r] += strip[r] * x0;
            odd[r] += strip[DGFEM_STRIP + r] * x1;
        }
    }
    if (k < columns)
        for (r = 0; r < DGFEM_STRIP; r++) even[r] += strip[r] * x[k];
    for (r = 0; r < DGFEM_STRIP; r++) sum[r] -= even[r] + odd[r];
}

/* x[k] -= sum over r of strip(r, k) y[r] */
static void dgfemi_strip_subtract_transposed(const dgfem_real *strip, int columns, const dgfem_real y[DGFEM_STRIP],
                                             dgfem_real *x) {
    int k, r;
    for (k = 0; k < columns; k++, strip += DGFEM_STRIP) {
        dgfem_real sum[4] = {0};
        for (r = 0; r < DGFEM_STRIP; r++) sum[r % 4] += strip[r] * y[r];
        x[k] -= (sum[0] + sum[1]) + (sum[2] + sum[3]);
    }
}

/* x = L^-1 x for a supernode's own unknowns; below = -B x. */
static void dgfemi_solve_panel(const dgfemi_panel *p, dgfem_real *x, dgfem_real *below) {
    int pivot_strips = dgfemi_strips(p->width), strips = dgfemi_panel_strips(p), strip, c, r;
    for (strip = 0; strip < pivot_strips; strip++) {
        int first = strip * DGFEM_STRIP, columns = dgfemi_strip_end(p, strip, p->width) - first;
        const dgfem_real *triangle = dgfemi_strip(p, strip) + (size_t)first * DGFEM_STRIP;
        dgfem_real y[DGFEM_STRIP] = {0};
        for (r = 0; r < columns; r++) y[r] = x[first + r];
        dgfemi_strip_subtract(dgfemi_strip(p, strip), first, x, y);
        for (c = 0; c < columns; c++, triangle += DGFEM_STRIP) {
            y[c] *= triangle[c];
            for (r = c + 1; r < columns; r++) y[r] -= triangle[r] * y[c];
        }
        for (r = 0; r < columns; r++) x[first + r] = y[r];
    }
    for (; strip < strips; strip++, below += DGFEM_STRIP) {
        for (r = 0; r < DGFEM_STRIP; r++) below[r] = 0;
        dgfemi_strip_subtract(dgfemi_strip(p, strip), p->width, x, below);
    }
}

/* x = L^-T (x - B^T below) */
static void dgfemi_solve_panel_transposed(const dgfemi_panel *p, dgfem_real *x, const dgfem_real *below) {
    int pivot_strips = dgfemi_strips(p->width), strips = dgfemi_panel_strips(p), strip, c, r;
    for (strip = pivot_strips; strip < strips; strip++, below += DGFEM_STRIP)
        dgfemi_strip_subtract_transposed(dgfemi_strip(p, strip), p->width, below, x);
    for (strip = pivot_strips - 1; strip >= 0; strip--) {
        int first = strip * DGFEM_STRIP, columns = dgfemi_strip_end(p, strip, p->width) - first;
        const dgfem_real *triangle = dgfemi_strip(p, strip) + (size_t)first * DGFEM_STRIP;
        dgfem_real y[DGFEM_STRIP] = {0};
        for (c = columns - 1; c >= 0; c--) {
            const dgfem_real *column = triangle + c * DGFEM_STRIP;
            y[c] = x[first + c];
            for (r = c + 1; r < columns; r++) y[c] -= column[r] * y[r];
            y[c] *= column[c];
        }
        for (r = 0; r < columns; r++) x[first + r] = y[r];
        dgfemi_strip_subtract_transposed(dgfemi_strip(p, strip), first, y, x);
    }
}

/* ==== cholesky.c ================================================================================================== */

/* Sparse Cholesky factorization A = L L^T of matrices in blocks: symbolic analysis, multifrontal factorization, solves.

   A supernode is a range of columns of L with (nearly) the same rows below; its parent holds the first of these rows.
   Its front gathers all that eliminating its columns needs and gives:

            width  height
          +-------+         panel: becomes width + height rows of L
          |   D   |         D holds the pivots, B is the part below
          +-------+------+
          |   B   |  U   |  U: -B B^T plus the updates of the children; added into the parent's front,
          +-------+------+     whose rows contain those of U

   Positions are blocks in the order of elimination. */

typedef struct dgfemi_supernode {
    int first, last;            /* positions first <= k < last */
    int column;                 /* its first unknown, in the order of elimination */
    int width, height;          /* unknowns */
    int parent, child, sibling; /* supernodes: parent, first child, next child of the parent; or DGFEM_NONE */
    int row_start, row_end;     /* the rows below, in dgfem_cholesky.rows */
    int run_start, run_end;     /* where they go in the parent's front, in dgfem_cholesky.runs */
    int entry_start, entry_end; /* the blocks of A that its columns begin with, in dgfem_cholesky.entries */
    size_t values;              /* its panel, in dgfem_cholesky.values */
    size_t update;              /* its U, in dgfem_cholesky.updates */
} dgfemi_supernode;

/* Consecutive rows below a supernode that are consecutive in the parent's front too, on one side of its width. */
typedef struct dgfemi_run {
    int row, front_row, length;
} dgfemi_run;

/* A stored block of A and where it goes in a front: as it is, or transposed where the order of elimination swaps its
   row and column. */
typedef struct dgfemi_entry {
    int block, rows, columns;
    int front_row, front_column, transposed;
} dgfemi_entry;

struct dgfem_cholesky {
    dgfem_hooks hooks;
    int block_count, size;
    uint64_t pattern; /* hash of the pattern analysed */
    int factored;     /* 1: values hold a factorization */
    int *order;       /* [block_count] the block at each position */
    int *offset;      /* [block_count + 1] first unknown of each position, in the order of elimination */
    int *source;      /* [block_count] first unknown of each position, in the order of the matrix */
    int supernode_count;
    dgfemi_supernode *supernodes; /* children before parents */
    int *rows;                    /* positions */
    dgfemi_run *runs;
    dgfemi_entry *entries;
    dgfem_real *values;   /* L */
    dgfem_real *panel;    /* one front's D and B while they are assembled: column-major */
    dgfem_real *updates;  /* the U that still wait for their parents: lower halves, packed by columns */
    dgfem_real *diagonal; /* [largest width] of A, in the front's columns */
    dgfem_real *x;        /* [size] a solve's vector in the order of elimination */
    dgfem_real *below;    /* [largest height, in whole strips] the part of it below a supernode */
    double factor_entries, factor_flops;
};

/* ---- symbolic analysis: the elimination tree and its supernodes ---- */

/* A fundamental supernode (columns with the same rows below) before merging; the others follow it in a chain. */
typedef struct dgfemi_node {
    int first, end;            /* positions first <= k < end */
    int width, height, blocks; /* unknowns; unknowns and blocks below */
    double zeros;              /* numbers in its columns that are zero in L */
    int child, sibling;        /* first child, next child of the parent; or DGFEM_NONE */
    int segment, last_segment; /* chain of the nodes that it consists of, in the order of their columns */
    int next_segment;
} dgfemi_node;

enum { DGFEM_MERGED = -2 }; /* the parent of a node that has been merged into its parent */

/* Scratch of the analysis. */
typedef struct dgfemi_analysis {
    dgfemi_graph graph;
    int *order, *position;     /* [block_count] inverse of each other */
    int *parent;               /* [block_count] elimination tree, of positions; later of nodes */
    int *below, *below_blocks; /* [block_count] unknowns and blocks below each block column of L */
    int *node_of;              /* [block_count] of each position, as it is before nodes merge */
    int *supernode_of;         /* [block_count] of each position, in the end */
    int *list, *scratch[2];    /* [block_count] */
    dgfemi_node *nodes;        /* [block_count] */
    int node_count;
} dgfemi_analysis;

static int dgfemi_analysis_allocate(dgfemi_analysis *a, dgfemi_arena *arena) {
    int **arrays[10];
    size_t n = (size_t)a->graph.count;
    int i;
    arrays[0] = &a->order, arrays[1] = &a->position, arrays[2] = &a->parent;
    arrays[3] = &a->below, arrays[4] = &a->below_blocks, arrays[5] = &a->node_of;
    arrays[6] = &a->supernode_of, arrays[7] = &a->list, arrays[8] = &a->scratch[0], arrays[9] = &a->scratch[1];
    for (i = 0; i < 10; i++) {
        *arrays[i] = (int *)dgfemi_arena_allocate(arena, n, sizeof(int));
        if (!*arrays[i]) return 0;
    }
    a->nodes = (dgfemi_node *)dgfemi_arena_allocate_zero(arena, n, sizeof(dgfemi_node));
    return a->nodes != NULL;
}

/* Lists the nodes of a forest, children before parents, each tree in one piece. child and sibling are scratch. Returns
   their number: nodes whose parent is DGFEM_MERGED do not count. */
static int dgfemi_postorder(int count, const int *parent, int *child, int *sibling, int *list) {
    int listed = 0, root, k;
    for (k = 0; k < count; k++) child[k] = DGFEM_NONE;
    for (k = count - 1; k >= 0; k--)
        if (parent[k] >= 0) {
            sibling[k] = child[parent[k]];
            child[parent[k]] = k;
        }
    for (root = 0; root < count; root++) {
        if (parent[root] != DGFEM_NONE) continue;
        for (k = root;;) {
            int next = child[k];
            if (next != DGFEM_NONE) { /* down to a child that has not been listed */
                child[k] = sibling[next];
                k = next;
                continue;
            }
            list[listed++] = k;
            if (k == root) break;
            k = parent[k];
        }
    }
    return listed;
}

/* Puts the order into postorder of its elimination tree, which makes the columns of a supernode neighbours and changes
   nothing else; tree and counts are then those of the new order. */
static void dgfemi_analyse_tree(dgfemi_analysis *a) {
    int n = a->graph.count, k;
    dgfemi_elimination_tree(&a->graph, a->order, a->position, a->parent, a->scratch[0]);
    dgfemi_postorder(n, a->parent, a->scratch[0], a->scratch[1], a->list);
    for (k = 0; k < n; k++) a->scratch[0][k] = a->order[a->list[k]];
    memcpy(a->order, a->scratch[0], (size_t)n * sizeof *a->order);
    dgfemi_elimination_tree(&a->graph, a->order, a->position, a->parent, a->scratch[0]);
    dgfemi_column_counts(&a->graph, a->order, a->position, a->parent, a->scratch[0], a->below, a->below_blocks);
}

/* Column k has the rows of column k + 1 and that one's diagonal block: they count as one. */
static int dgfemi_continues_node(const dgfemi_analysis *a, int k) {
    return a->parent[k] == k + 1 && a->below[k] == a->below[k + 1] + a->graph.weight[a->order[k + 1]];
}

/* Nodes and, in a->parent, their tree. */
static void dgfemi_make_nodes(dgfemi_analysis *a) {
    int n = a->graph.count, k, i;
    a->node_count = 0;
    for (k = 0; k < n; k++) {
        dgfemi_node *node = a->nodes + a->node_count;
        if (node->width == 0) node->first = k;
        node->width += a->graph.weight[a->order[k]];
        a->node_of[k] = a->node_count;
        if (k + 1 < n && dgfemi_continues_node(a, k)) continue;
        node->end = k + 1;
        node->height = a->below[k];
        node->blocks = a->below_blocks[k];
        node->child = node->sibling = node->next_segment = DGFEM_NONE;
        node->segment = node->last_segment = a->node_count++;
    }
    for (i = 0; i < a->node_count; i++) { /* i <= nodes[i].first: what is overwritten has been read */
        int up = a->parent[a->nodes[i].end - 1];
        a->parent[i] = up == DGFEM_NONE ? DGFEM_NONE : a->node_of[up];
    }
    for (i = a->node_count - 1; i >= 0; i--)
        if (a->parent[i] != DGFEM_NONE) {
            a->nodes[i].sibling = a->nodes[a->parent[i]].child;
            a->nodes[a->parent[i]].child = i;
        }
}

/* Merging a child into its parent makes all its columns as long as the parent's: wider panels and fewer updates for a
   few more zeros. The limits are by measurement. */
static int dgfemi_worth_merging(double width, double height, double zeros) {
    double entries = width * (width + 1) / 2 + width * height;
    if (width <= 16) return 1;
    if (width <= 48) return zeros < 0.2 * entries;
    if (width <= 96) return zeros < 0.1 * entries;
    return zeros < 0.03 * entries;
}

static int dgfemi_try_merging(dgfemi_analysis *a, int child, int parent) {
    dgfemi_node *c = a->nodes + child, *p = a->nodes + parent;
    double added = (double)c->width * ((double)p->width + p->height - c->height);
    double zeros = c->zeros + p->zeros + added;
    if (!dgfemi_worth_merging((double)c->width + p->width, p->height, zeros)) return 0;
    p->zeros = zeros;
    p->width += c->width;
    a->nodes[c->last_segment].next_segment = p->segment;
    p->segment = c->segment;
    a->parent[child] = DGFEM_MERGED;
    return 1;
}

/* Bottom up, so that what merges has merged with its own children before. */
static void dgfemi_merge_nodes(dgfemi_analysis *a) {
    int p, next;
    for (p = 0; p < a->node_count; p++) {
        int pending = a->nodes[p].child;
        a->nodes[p].child = DGFEM_NONE;
        while (pending != DGFEM_NONE) {
            int c = pending;
            pending = a->nodes[c].sibling;
            if (dgfemi_try_merging(a, c, p)) {
                int grandchild = a->nodes[c].child;
                for (; grandchild != DGFEM_NONE; grandchild = next) { /* are the parent's children now */
                    next = a->nodes[grandchild].sibling;
                    a->parent[grandchild] = p;
                    a->nodes[grandchild].sibling = pending;
                    pending = grandchild;
                }
            } else {
                a->nodes[c].sibling = a->nodes[p].child;
                a->nodes[p].child = c;
            }
        }
    }
}

/* ---- symbolic analysis: what the factorization follows ---- */

/* Gives the blocks their final places: node after node as listed, and in each the columns merged into it before its
   own. */
static void dgfemi_place_blocks(dgfem_cholesky *c, dgfemi_analysis *a) {
    int *order = a->below; /* done with */
    int placed = 0, s, i, k;
    for (s = 0; s < c->supernode_count; s++) {
        c->supernodes[s].first = placed;
        for (i = a->nodes[a->list[s]].segment; i != DGFEM_NONE; i = a->nodes[i].next_segment)
            for (k = a->nodes[i].first; k < a->nodes[i].end; k++) {
                a->supernode_of[placed] = s;
                order[placed++] = a->order[k];
            }
        c->supernodes[s].last = placed;
    }
    for (k = 0; k < placed; k++) {
        a->order[k] = order[k];
        a->position[order[k]] = k;
    }
}

/* Supernodes from the nodes that are left, and the final order. 0 when out of memory. */
static int dgfemi_make_supernodes(dgfem_cholesky *c, dgfemi_analysis *a) {
    int *supernode_of_node = a->below_blocks; /* done with: the nodes have their counts */
    int column = 0, s;
    double rows = 0;
    c->supernode_count = dgfemi_postorder(a->node_count, a->parent, a->scratch[0], a->scratch[1], a->list);
    c->supernodes =
        (dgfemi_supernode *)dgfemi_allocate_zero(&c->hooks, (size_t)c->supernode_count, sizeof *c->supernodes);
    if (!c->supernodes) return 0;
    for (s = 0; s < c->supernode_count; s++) supernode_of_node[a->list[s]] = s;
    dgfemi_place_blocks(c, a);
    for (s = 0; s < c->supernode_count; s++) {
        dgfemi_supernode *super = c->supernodes + s;
        const dgfemi_node *node = a->nodes + a->list[s];
        int parent = a->parent[a->list[s]];
        super->parent = parent == DGFEM_NONE ? DGFEM_NONE : supernode_of_node[parent];
        super->child = super->sibling = DGFEM_NONE;
        super->column = column;
        super->width = node->width;
        super->height = node->height;
        column += node->width;
        super->row_start = super->row_end = (int)rows;
        rows += node->blocks;
        if (rows > INT_MAX) return 0;
    }
    c->rows = (int *)dgfemi_allocate(&c->hooks, (size_t)rows, sizeof(int));
    return c->rows != NULL;
}

/* Children in ascending order. */
static void dgfemi_link_children(dgfem_cholesky *c) {
    int s;
    for (s = c->supernode_count - 1; s >= 0; s--) {
        dgfemi_supernode *super = c->supernodes + s;
        if (super->parent == DGFEM_NONE) continue;
        super->sibling = c->supernodes[super->parent].child;
        c->supernodes[super->parent].child = s;
    }
}

/* Row i of L reaches the supernodes on the way from its neighbours in A up the tree to its own. Rows are visited in
   ascending order, and so enter each list. */
static void dgfemi_make_rows(dgfem_cholesky *c, dgfemi_analysis *a) {
    const dgfemi_graph *graph = &a->graph;
    int *mark = a->scratch[0], i, k, s;
    for (s = 0; s < c->supernode_count; s++) mark[s] = DGFEM_NONE;
    for (i = 0; i < graph->count; i++) {
        int v = a->order[i];
        mark[a->supernode_of[i]] = i;
        for (k = graph->start[v]; k < graph->start[v + 1]; k++) {
            int j = a->position[graph->neighbour[k]];
            if (j > i) continue;
            for (s = a->supernode_of[j]; mark[s] != i; s = c->supernodes[s].parent) {
                mark[s] = i;
                c->rows[c->supernodes[s].row_end++] = i;
            }
        }
    }
}

/* The row in a supernode's front of each position that has one. */
static void dgfemi_map_front(const dgfem_cholesky *c, const dgfemi_supernode *super, int *front_row) {
    int row = super->width, i;
    for (i = super->first; i < super->last; i++) front_row[i] = c->offset[i] - super->column;
    for (i = super->row_start; i < super->row_end; i++) {
        front_row[c->rows[i]] = row;
        row += c->offset[c->rows[i] + 1] - c->offset[c->rows[i]];
    }
}

/* Where the rows below a supernode go in its parent's front. Returns the number of runs made by now. */
static int dgfemi_make_runs(dgfem_cholesky *c, dgfemi_supernode *super, const int *front_row, int used) {
    int width = c->supernodes[super->parent].width, row = 0, k;
    super->run_start = used;
    for (k = super->row_start; k < super->row_end; k++) {
        int i = c->rows[k], length = c->offset[i + 1] - c->offset[i];
        dgfemi_run *run = c->runs + used;
        if (used > super->run_start && run[-1].front_row + run[-1].length == front_row[i] && front_row[i] != width)
            run[-1].length += length;
        else {
            run->row = row;
            run->front_row = front_row[i];
            run->length = length;
            used++;
        }
        row += length;
    }
    super->run_end = used;
    return used;
}

/* Where the stored blocks of A go that a supernode's columns begin with: those that couple its blocks to themselves and
   to later ones. Returns the number of entries made by now. */
static int dgfemi_make_entries(dgfem_cholesky *c, dgfemi_supernode *super, const dgfemi_analysis *a,
                               const dgfem_matrix *matrix, const int *front_row, int used) {
    const dgfemi_graph *graph = &a->graph;
    int i, k;
    super->entry_start = used;
    for (i = super->first; i < super->last; i++) {
        int v = a->order[i];
        for (k = graph->start[v]; k <= graph->start[v + 1]; k++) {
            int u = k < graph->start[v + 1] ? graph->neighbour[k] : v; /* at last the diagonal block */
            dgfemi_entry *entry = c->entries + used;
            if (a->position[u] < i) continue;
            entry->block = u == v ? dgfemi_diagonal_index(matrix, v) : graph->block[k];
            entry->rows = graph->weight[u > v ? u : v];
            entry->columns = graph->weight[u > v ? v : u];
            entry->front_row = front_row[a->position[u]];
            entry->front_column = front_row[i];
            entry->transposed = u < v;
            used++;
        }
    }
    super->entry_end = used;
    return used;
}

/* 0 when out of memory. */
static int dgfemi_make_fronts(dgfem_cholesky *c, const dgfemi_analysis *a, const dgfem_matrix *matrix) {
    int *front_row = a->scratch[0], rows = 0, runs = 0, entries = 0, s, t;
    if (c->supernode_count > 0) rows = c->supernodes[c->supernode_count - 1].row_end;
    c->runs = (dgfemi_run *)dgfemi_allocate(&c->hooks, (size_t)rows, sizeof *c->runs);
    c->entries =
        (dgfemi_entry *)dgfemi_allocate(&c->hooks, (size_t)matrix->row_start[matrix->block_count], sizeof *c->entries);
    if (!c->runs || !c->entries) return 0;
    for (s = 0; s < c->supernode_count; s++) {
        dgfemi_supernode *super = c->supernodes + s;
        dgfemi_map_front(c, super, front_row);
        entries = dgfemi_make_entries(c, super, a, matrix, front_row, entries);
        for (t = super->child; t != DGFEM_NONE; t = c->supernodes[t].sibling)
            runs = dgfemi_make_runs(c, c->supernodes + t, front_row, runs);
    }
    return 1;
}

/* Reserves what factorizations and solves need. Update matrices lie on two stacks, for even and odd depths of the tree:
   a front writes its own to one while those of its children are still on the other, and then drops them from the top.
   0 when out of memory. */
static int dgfemi_plan_memory(dgfem_cholesky *c, const dgfemi_analysis *a) {
    int *stack = a->scratch[0], width = 0, strips = 0, s, t;
    size_t values = 0, panel = 0, top[2] = {0, 0}, peak[2] = {0, 0};
    for (s = c->supernode_count - 1; s >= 0; s--)
        stack[s] = c->supernodes[s].parent == DGFEM_NONE ? 0 : !stack[c->supernodes[s].parent];
    for (s = 0; s < c->supernode_count; s++) {
        dgfemi_supernode *super = c->supernodes + s;
        size_t w = (size_t)super->width, h = (size_t)super->height, *own = top + stack[s], *other = top + !stack[s];
        size_t front = dgfemi_add_product(0, w, w + h);
        int below = dgfemi_strips(super->height);
        super->values = values;
        values = dgfemi_add_product(values, w, (size_t)(dgfemi_strips(super->width) + below) * DGFEM_STRIP);
        super->update = *own;
        *own = h % 2 ? dgfemi_add_product(*own, h, (h + 1) / 2) : dgfemi_add_product(*own, h / 2, h + 1);
        for (t = super->child; t != DGFEM_NONE; t = c->supernodes[t].sibling)
            if (c->supernodes[t].update < *other) *other = c->supernodes[t].update;
        if (*own > peak[stack[s]]) peak[stack[s]] = *own;
        if (front > panel) panel = front;
        if (super->width > width) width = super->width;
        if (below > strips) strips = below;
    }
    for (s = 0; s < c->supernode_count; s++)
        if (stack[s]) c->supernodes[s].update += peak[0];
    c->values = (dgfem_real *)dgfemi_allocate(&c->hooks, values, sizeof(dgfem_real));
    c->panel = (dgfem_real *)dgfemi_allocate(&c->hooks, panel, sizeof(dgfem_real));
    c->updates = (dgfem_real *)dgfemi_allocate(&c->hooks, dgfemi_add_product(peak[0], peak[1], 1), sizeof(dgfem_real));
    c->diagonal = (dgfem_real *)dgfemi_allocate(&c->hooks, (size_t)width, sizeof(dgfem_real));
    c->x = (dgfem_real *)dgfemi_allocate(&c->hooks, (size_t)c->size, sizeof(dgfem_real));
    c->below = (dgfem_real *)dgfemi_allocate(&c->hooks, (size_t)strips * DGFEM_STRIP, sizeof(dgfem_real));
    return c->values && c->panel && c->updates && c->diagonal && c->x && c->below;
}

/* Needs the final order. 0 when out of memory. */
static int dgfemi_make_offsets(dgfem_cholesky *c, const dgfemi_analysis *a, const dgfem_matrix *matrix) {
    int n = c->block_count, k;
    c->order = (int *)dgfemi_duplicate(&c->hooks, a->order, (size_t)n, sizeof(int));
    c->offset = (int *)dgfemi_allocate(&c->hooks, (size_t)n + 1, sizeof(int));
    c->source = (int *)dgfemi_allocate(&c->hooks, (size_t)n, sizeof(int));
    if (!c->order || !c->offset || !c->source) return 0;
    c->offset[0] = 0;
    for (k = 0; k < n; k++) {
        c->offset[k + 1] = c->offset[k] + a->graph.weight[a->order[k]];
        c->source[k] = matrix->offset[a->order[k]];
    }
    return 1;
}

/* FNV-1a over all that makes the pattern. */
static uint64_t dgfemi_pattern_hash(const dgfem_matrix *matrix) {
    const int *arrays[3];
    size_t lengths[3], i;
    uint64_t hash = 14695981039346656037u;
    int k;
    arrays[0] = matrix->offset, lengths[0] = (size_t)matrix->block_count + 1;
    arrays[1] = matrix->row_start, lengths[1] = (size_t)matrix->block_count + 1;
    arrays[2] = matrix->column, lengths[2] = (size_t)matrix->row_start[matrix->block_count];
    for (k = 0; k < 3; k++)
        for (i = 0; i < lengths[k]; i++) hash = (hash ^ (uint64_t)arrays[k][i]) * 1099511628211u;
    return hash;
}

/* 0 when out of memory. */
static int dgfemi_analyse(dgfem_cholesky *c, const dgfem_matrix *matrix, dgfem_ordering ordering, dgfemi_arena *arena) {
    dgfemi_analysis analysis, *a = &analysis;
    if (!dgfemi_graph_make(arena, matrix, &a->graph) || !dgfemi_analysis_allocate(a, arena)) return 0;
    if (!dgfemi_order_blocks(arena, &a->graph, matrix->centres, ordering, a->order)) return 0;
    dgfemi_analyse_tree(a);
    dgfemi_factor_cost(&a->graph, a->order, a->below, &c->factor_entries, &c->factor_flops);
    dgfemi_make_nodes(a);
    dgfemi_merge_nodes(a);
    if (!dgfemi_make_supernodes(c, a) || !dgfemi_make_offsets(c, a, matrix)) return 0;
    dgfemi_link_children(c);
    dgfemi_make_rows(c, a);
    return dgfemi_make_fronts(c, a, matrix) && dgfemi_plan_memory(c, a);
}

DGFEM_API dgfem_cholesky_desc dgfem_default_cholesky_desc(void) {
    dgfem_cholesky_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.ordering = DGFEM_ORDERING_AUTO;
    return desc;
}

DGFEM_API dgfem_status dgfem_cholesky_create(const dgfem_matrix *matrix, const dgfem_cholesky_desc *desc,
                                             dgfem_cholesky **out) {
    dgfemi_arena arena;
    dgfem_cholesky *c;
    dgfem_status status;
    int analysed = 0;
    if (out) *out = NULL;
    status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (status) return status;
    if (!matrix || !out) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: matrix or out is NULL");
    if ((int)desc->ordering < 0 || desc->ordering > DGFEM_ORDERING_NESTED_DISSECTION)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: unknown ordering %d", (int)desc->ordering);
    if (desc->ordering == DGFEM_ORDERING_NESTED_DISSECTION && !matrix->centres)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: nested dissection needs the blocks' centres");
    c = (dgfem_cholesky *)dgfemi_allocate_zero(&desc->hooks, 1, sizeof *c);
    if (c) {
        c->hooks = desc->hooks;
        c->block_count = matrix->block_count;
        c->size = matrix->size;
        c->pattern = dgfemi_pattern_hash(matrix);
        arena = dgfemi_arena_make(&desc->hooks);
        analysed = dgfemi_analyse(c, matrix, desc->ordering, &arena);
        dgfemi_arena_free(&arena);
    }
    if (!analysed) {
        dgfem_cholesky_destroy(c);
        return dgfemi_fail_memory(&desc->hooks);
    }
    *out = c;
    return DGFEM_OK;
}

DGFEM_API void dgfem_cholesky_destroy(dgfem_cholesky *c) {
    dgfem_hooks hooks;
    if (!c) return;
    hooks = c->hooks;
    dgfemi_free(&hooks, c->order);
    dgfemi_free(&hooks, c->offset);
    dgfemi_free(&hooks, c->source);
    dgfemi_free(&hooks, c->supernodes);
    dgfemi_free(&hooks, c->rows);
    dgfemi_free(&hooks, c->runs);
    dgfemi_free(&hooks, c->entries);
    dgfemi_free(&hooks, c->values);
    dgfemi_free(&hooks, c->panel);
    dgfemi_free(&hooks, c->updates);
    dgfemi_free(&hooks, c->diagonal);
    dgfemi_free(&hooks, c->x);
    dgfemi_free(&hooks, c->below);
    dgfemi_free(&hooks, c);
}

/* ---- numeric factorization ---- */

/* Adds one block of A to the front; of diagonal blocks the lower half. */
static void dgfemi_add_entry(const dgfemi_entry *entry, const dgfem_real *block, dgfem_real *panel, size_t stride) {
    dgfem_real *to = panel + (size_t)entry->front_column * stride + entry->front_row;
    int diagonal = entry->front_row == entry->front_column, i, j;
    if (entry->transposed) {
        for (i = 0; i < entry->rows; i++, block += entry->columns, to += stride)
            for (j = 0; j < entry->columns; j++) to[j] = block[j];
    } else {
        for (j = 0; j < entry->columns; j++, to += stride)
            for (i = diagonal ? j : 0; i < entry->rows; i++)
                to[i] = block[(size_t)i * (size_t)entry->columns + (size_t)j];
    }
}

/* Adds the columns of a child's update that belong to the front's panel (column-major, width + height rows), or those
   that belong to its own update. */
static void dgfemi_add_child(const dgfem_cholesky *c, const dgfemi_supernode *super, const dgfemi_supernode *child,
                             int in_panel) {
    const dgfem_real *from = c->updates + child->update;
    int target, k, j;
    for (target = child->run_start; target < child->run_end; target++) {
        const dgfemi_run *columns = c->runs + target;
        if ((columns->front_row < super->width) != in_panel) continue;
        for (j = 0; j < columns->length; j++) {
            const dgfem_real *source = from + dgfemi_packed(child->height, columns->row + j);
            int column = columns->front_row + j, skip = j; /* of the first run: what is above the diagonal */
            dgfem_real *to;
            int shift = in_panel ? 0 : super->width;
            if (in_panel) to = c->panel + (size_t)column * ((size_t)super->width + (size_t)super->height);
            else to = c->updates + super->update + dgfemi_packed(super->height, column - shift);
            for (k = target; k < child->run_end; k++, skip = 0) {
                const dgfemi_run *rows = c->runs + k;
                dgfemi_add_vector(to + (rows->front_row - shift + skip), source + rows->row + skip,
                                  rows->length - skip);
            }
        }
    }
}

/* Gathers D and B of a front: from A, whose diagonal is kept, and from the children. */
static void dgfemi_assemble(dgfem_cholesky *c, const dgfemi_supernode *super, const dgfem_matrix *matrix) {
    size_t stride = (size_t)super->width + (size_t)super->height;
    int k;
    memset(c->panel, 0, (size_t)super->width * stride * sizeof(dgfem_real));
    for (k = super->entry_start; k < super->entry_end; k++)
        dgfemi_add_entry(c->entries + k, matrix->values + matrix->value_start[c->entries[k].block], c->panel, stride);
    for (k = 0; k < super->width; k++) c->diagonal[k] = c->panel[(size_t)k * (stride + 1)];
    for (k = super->child; k != DGFEM_NONE; k = c->supernodes[k].sibling)
        dgfemi_add_child(c, super, c->supernodes + k, 1);
}

static dgfemi_panel dgfemi_panel_of(const dgfem_cholesky *c, const dgfemi_supernode *super) {
    dgfemi_panel panel;
    panel.values = c->values + super->values;
    panel.width = super->width;
    panel.height = super->height;
    return panel;
}

/* Children come before parents; no front looks at any other than its children. Returns the position whose pivot fails,
   or DGFEM_NONE. */
static int dgfemi_factor(dgfem_cholesky *c, const dgfem_matrix *matrix) {
    int s, t;
    for (s = 0; s < c->supernode_count; s++) {
        const dgfemi_supernode *super = c->supernodes + s;
        dgfemi_panel panel = dgfemi_panel_of(c, super);
        int failed;
        dgfemi_assemble(c, super, matrix);
        dgfemi_pack_panel(&panel, c->panel);
        failed = dgfemi_factor_panel(&panel, c->diagonal);
        if (failed != DGFEM_NONE) {
            for (t = super->first; c->offset[t + 1] <= super->column + failed;) t++;
            return t;
        }
        dgfemi_make_update(&panel, c->updates + super->update);
        for (t = super->child; t != DGFEM_NONE; t = c->supernodes[t].sibling)
            dgfemi_add_child(c, super, c->supernodes + t, 0);
    }
    return DGFEM_NONE;
}

DGFEM_API dgfem_status dgfem_cholesky_factor(dgfem_cholesky *c, const dgfem_matrix *matrix, dgfem_cholesky_info *info) {
    int failed;
    if (info) {
        memset(info, 0, sizeof *info);
        info->failed_block = DGFEM_NONE;
    }
    if (!c) return DGFEM_ERROR_ARGUMENT;
    if (!matrix) return dgfemi_fail(&c->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: matrix is NULL");
    if (info) {
        info->factor_entries = c->factor_entries;
        info->factor_flops = c->factor_flops;
        info->supernodes = c->supernode_count;
    }
    if (matrix->block_count != c->block_count || matrix->size != c->size || dgfemi_pattern_hash(matrix) != c->pattern)
        return dgfemi_fail(&c->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: the matrix has not the pattern analysed");
    failed = dgfemi_factor(c, matrix);
    c->factored = failed == DGFEM_NONE;
    if (c->factored) return DGFEM_OK;
    if (info) info->failed_block = c->order[failed];
    return dgfemi_fail(&c->hooks, DGFEM_ERROR_NOT_POSITIVE_DEFINITE, "cholesky: pivot of block %d", c->order[failed]);
}

/* ---- solves ---- */

/* The part of x at the rows below a supernode, or what changes it. */
static void dgfemi_add_below(const dgfem_cholesky *c, const dgfemi_supernode *super) {
    const dgfem_real *below = c->below;
    int k;
    for (k = super->row_start; k < super->row_end; k++) {
        int first = c->offset[c->rows[k]], count = c->offset[c->rows[k] + 1] - first;
        dgfemi_add_vector(c->x + first, below, count);
        below += count;
    }
}

static void dgfemi_gather_below(const dgfem_cholesky *c, const dgfemi_supernode *super) {
    dgfem_real *below = c->below;
    int padding = dgfemi_strips(super->height) * DGFEM_STRIP - super->height, k, i;
    for (k = super->row_start; k < super->row_end; k++) {
        int first = c->offset[c->rows[k]], count = c->offset[c->rows[k] + 1] - first;
        for (i = 0; i < count; i++) *below++ = c->x[first + i];
    }
    for (i = 0; i < padding; i++) *below++ = 0;
}

static void dgfemi_solve(const dgfem_cholesky *c, const dgfem_real *b, dgfem_real *x) {
    int s, k, i;
    for (k = 0; k < c->block_count; k++)
        for (i = c->offset[k]; i < c->offset[k + 1]; i++) c->x[i] = b[c->source[k] + i - c->offset[k]];
    for (s = 0; s < c->supernode_count; s++) {
        dgfemi_panel panel = dgfemi_panel_of(c, c->supernodes + s);
        dgfemi_solve_panel(&panel, c->x + c->supernodes[s].column, c->below);
        dgfemi_add_below(c, c->supernodes + s);
    }
    for (s = c->supernode_count - 1; s >= 0; s--) {
        dgfemi_panel panel = dgfemi_panel_of(c, c->supernodes + s);
        dgfemi_gather_below(c, c->supernodes + s);
        dgfemi_solve_panel_transposed(&panel, c->x + c->supernodes[s].column, c->below);
    }
    for (k = 0; k < c->block_count; k++)
        for (i = c->offset[k]; i < c->offset[k + 1]; i++) x[c->source[k] + i - c->offset[k]] = c->x[i];
}

DGFEM_API dgfem_status dgfem_cholesky_solve(const dgfem_cholesky *c, const dgfem_real *b, dgfem_real *x) {
    int bad;
    if (!c) return DGFEM_ERROR_ARGUMENT;
    if (!b || !x) return dgfemi_fail(&c->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: b or x is NULL");
    if (!c->factored) return dgfemi_fail(&c->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: no factorization to solve with");
    bad = dgfemi_vector_not_finite(c->size, b);
    if (bad != DGFEM_NONE) return dgfemi_fail(&c->hooks, DGFEM_ERROR_NOT_FINITE, "cholesky: b[%d]", bad);
    dgfemi_solve(c, b, x);
    return DGFEM_OK;
}

/* ==== pcg.c ======================================================================================================= */

/* Conjugate gradients, preconditioned by the inverse diagonal blocks. */

DGFEM_API dgfem_pcg_desc dgfem_default_pcg_desc(void) {
    dgfem_pcg_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.tolerance = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-5) : DGFEM_R(1e-8);
    desc.max_iterations = 1000;
    return desc;
}

/* ---- vectors ---- */

/* In chunks of a fixed length, so that the sum does not depend on who adds up which chunk; in double, so that no
   squares vanish in single precision. */
static double dgfemi_vector_dot(int count, const dgfem_real *x, const dgfem_real *y) {
    enum { CHUNK = 1024 };
    double total = 0;
    int first, i, k;
    for (first = 0; first < count; first += CHUNK) {
        int last = count - first < CHUNK ? count : first + CHUNK;
        double sum[4] = {0};
        for (i = first; i + 4 <= last; i += 4)
            for (k = 0; k < 4; k++) sum[k] += (double)x[i + k] * (double)y[i + k];
        for (; i < last; i++) sum[0] += (double)x[i] * (double)y[i];
        total += (sum[0] + sum[1]) + (sum[2] + sum[3]);
    }
    return total;
}

/* y = x + s y */
static void dgfemi_vector_scale_add(int count, const dgfem_real *x, dgfem_real s, dgfem_real *y) {
    int i;
    for (i = 0; i < count; i++) y[i] = x[i] + s * y[i];
}

/* y += s x */
static void dgfemi_vector_add(int count, dgfem_real s, const dgfem_real *x, dgfem_real *y) {
    int i;
    for (i = 0; i < count; i++) y[i] += s * x[i];
}

/* ---- block-Jacobi ---- */

/* From L with A = L L^T (lower half, row-major) to the whole of A^-1 = L^-T L^-1, in place. */
static void dgfemi_invert_from_cholesky(dgfem_real *a, int n) {
    int i, j, k;
    for (j = 0; j < n; j++) { /* column j of L^-1: the columns behind it are still those of L */
        a[j * n + j] = 1 / a[j * n + j];
        for (i = j + 1; i < n; i++) {
            dgfem_real sum = 0;
            for (k = j; k < i; k++) sum += a[i * n + k] * a[k * n + j];
            a[i * n + j] = -sum / a[i * n + i];
        }
    }
    for (j = 0; j < n; j++)
        for (i = j; i < n; i++) {
            dgfem_real sum = 0;
            for (k = i; k < n; k++) sum += a[k * n + i] * a[k * n + j];
            a[i * n + j] = a[j * n + i] = sum;
        }
}

/* Inverts all diagonal blocks into `inverse`, one behind the other. Returns a block that is not positive definite, or
   DGFEM_NONE. */
static int dgfemi_invert_diagonal(const dgfem_matrix *matrix, dgfem_real *inverse) {
    int r;
    for (r = 0; r < matrix->block_count; r++) {
        int n = dgfemi_block_size(matrix, r);
        size_t count = (size_t)n * (size_t)n, from = matrix->value_start[dgfemi_diagonal_index(matrix, r)];
        memcpy(inverse, matrix->values + from, count * sizeof *inverse);
        if (!dgfemi_cholesky_dense(inverse, n)) return r;
        dgfemi_invert_from_cholesky(inverse, n);
        inverse += count;
    }
    return DGFEM_NONE;
}

/* z = D^-1 r */
static void dgfemi_precondition(const dgfem_matrix *matrix, const dgfem_real *inverse, const dgfem_real *r,
                                dgfem_real *z) {
    int k;
    memset(z, 0, (size_t)matrix->size * sizeof *z);
    for (k = 0; k < matrix->block_count; k++) {
        int n = dgfemi_block_size(matrix, k), first = matrix->offset[k];
        dgfemi_block_multiply(inverse, n, n, r + first, z + first);
        inverse += (size_t)n * (size_t)n;
    }
}

/* ---- iteration ---- */

typedef struct dgfemi_pcg {
    const dgfem_matrix *matrix;
    const dgfem_real *b;
    dgfem_real *x;
    dgfem_real *r, *z, *p, *q; /* residual, D^-1 r, direction, A p */
    dgfem_real *best;          /* the iterate of the smallest residual */
    dgfem_real *inverse;       /* of the diagonal blocks */
    double norm;               /* b . D^-1 b */
    double rho;                /* r . D^-1 r */
    double best_rho;
} dgfemi_pcg;

static void dgfemi_pcg_set_best(dgfemi_pcg *s) {
    s->best_rho = s->rho;
    memcpy(s->best, s->x, (size_t)s->matrix->size * sizeof *s->x);
}

/* The residual itself, not as carried along; and a new start from it. */
static void dgfemi_pcg_restart(dgfemi_pcg *s) {
    int n = s->matrix->size, i;
    dgfem_matrix_multiply(s->matrix, s->x, s->q);
    for (i = 0; i < n; i++) s->r[i] = s->b[i] - s->q[i];
    dgfemi_precondition(s->matrix, s->inverse, s->r, s->z);
    memcpy(s->p, s->z, (size_t)n * sizeof *s->p);
    s->rho = dgfemi_vector_dot(n, s->r, s->z);
    dgfemi_pcg_set_best(s);
}

/* One step of Hestenes and Stiefel. 0 on breakdown: A or D^-1 is not positive definite, or a number not finite. */
static int dgfemi_pcg_iterate(dgfemi_pcg *s) {
    int n = s->matrix->size;
    double curvature, rho;
    dgfem_real step;
    dgfem_matrix_multiply(s->matrix, s->p, s->q);
    curvature = dgfemi_vector_dot(n, s->p, s->q);
    step = (dgfem_real)(s->rho / curvature);
    if (!(curvature > 0) || !(step > 0) || !dgfemi_is_finite(step)) return 0;
    dgfemi_vector_add(n, step, s->p, s->x);
    dgfemi_vector_add(n, -step, s->q, s->r);
    dgfemi_precondition(s->matrix, s->inverse, s->r, s->z);
    rho = dgfemi_vector_dot(n, s->r, s->z);
    if (!(rho >= 0) || !(rho - rho == 0)) return 0;
    dgfemi_vector_scale_add(n, s->z, (dgfem_real)(rho / s->rho), s->p);
    s->rho = rho;
    return 1;
}

/* 1 when converged. The residual that is carried along drifts from the true one, and keeps falling where that cannot:
   when it is small enough, or as small as round-off, the true one is computed and the iteration starts anew from it, as
   long as this gains something. */
static int dgfemi_pcg_run(dgfemi_pcg *s, const dgfem_pcg_desc *desc, int *iterations) {
    double target = (double)desc->tolerance * (double)desc->tolerance * s->norm;
    double noise = (double)DGFEM_EPSILON * (double)DGFEM_EPSILON * s->norm, last_true;
    *iterations = 0;
    dgfemi_pcg_restart(s);
    last_true = s->rho;
    while (!(s->rho <= target)) {
        if (*iterations == desc->max_iterations || !dgfemi_pcg_iterate(s)) return 0;
        ++*iterations;
        if (s->rho < s->best_rho) dgfemi_pcg_set_best(s);
        if (s->rho > target && s->rho > noise) continue;
        dgfemi_pcg_restart(s);
        if (s->rho > target && !(s->rho < last_true / 4)) return 0;
        last_true = s->rho;
    }
    return 1;
}

/* `work` has room for dgfem_pcg_work_size. Returns OK, NOT_POSITIVE_DEFINITE or NOT_CONVERGED. */
static dgfem_status dgfemi_pcg_solve(const dgfem_matrix *matrix, const dgfem_pcg_desc *desc, const dgfem_real *b,
                                     dgfem_real *x, dgfem_real *work, dgfem_pcg_info *info) {
    dgfemi_pcg solver, *s = &solver;
    size_t n = (size_t)matrix->size;
    int converged;
    s->matrix = matrix;
    s->b = b;
    s->x = x;
    s->r = work, s->z = work + n, s->p = work + 2 * n, s->q = work + 3 * n, s->best = work + 4 * n;
    s->inverse = work + 5 * n;
    info->failed_block = dgfemi_invert_diagonal(matrix, s->inverse);
    if (info->failed_block != DGFEM_NONE) return DGFEM_ERROR_NOT_POSITIVE_DEFINITE;
    dgfemi_precondition(matrix, s->inverse, b, s->z);
    s->norm = dgfemi_vector_dot(matrix->size, b, s->z);
    info->residual = (dgfem_real)HUGE_VAL;
    if (!(s->norm > 0) || !(s->norm - s->norm == 0)) return DGFEM_ERROR_NOT_CONVERGED;
    converged = dgfemi_pcg_run(s, desc, &info->iterations);
    if (!converged) {
        memcpy(x, s->best, n * sizeof *x);
        dgfemi_pcg_restart(s);
    }
    info->residual = (dgfem_real)sqrt(s->rho / s->norm);
    return converged ? DGFEM_OK : DGFEM_ERROR_NOT_CONVERGED;
}

DGFEM_API size_t dgfem_pcg_work_size(const dgfem_matrix *matrix) {
    size_t total = 0;
    int r;
    if (!matrix) return 0;
    for (r = 0; r < matrix->block_count; r++) {
        size_t n = (size_t)dgfemi_block_size(matrix, r);
        total += 5 * n + n * n;
    }
    return total;
}

static dgfem_status dgfemi_pcg_check(const dgfem_matrix *matrix, const dgfem_pcg_desc *desc, const dgfem_real *b,
                                     const dgfem_real *x) {
    const dgfem_hooks *hooks = &desc->hooks;
    int i;
    if (!matrix || !b || !x || b == x)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "pcg: matrix, b or x is NULL, or b is x");
    if (!(desc->tolerance >= 0) || !dgfemi_is_finite(desc->tolerance))
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "pcg: tolerance %g", (double)desc->tolerance);
    if (desc->max_iterations < 0)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "pcg: max_iterations %d", desc->max_iterations);
    i = dgfemi_vector_not_finite(matrix->size, b);
    if (i != DGFEM_NONE) return dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "pcg: b[%d]", i);
    i = dgfemi_vector_not_finite(matrix->size, x);
    if (i != DGFEM_NONE) return dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "pcg: x[%d]", i);
    return DGFEM_OK;
}

static int dgfemi_vector_is_zero(int count, const dgfem_real *x) {
    int i;
    for (i = 0; i < count; i++)
        if (x[i] != 0) return 0;
    return 1;
}

DGFEM_API dgfem_status dgfem_pcg(const dgfem_matrix *matrix, const dgfem_pcg_desc *desc, const dgfem_real *b,
                                 dgfem_real *x, dgfem_pcg_info *info) {
    dgfem_pcg_info result;
    dgfem_real *work;
    dgfem_status status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    memset(&result, 0, sizeof result);
    result.failed_block = DGFEM_NONE;
    if (info) *info = result;
    if (!status) status = dgfemi_pcg_check(matrix, desc, b, x);
    if (status) return status;
    if (dgfemi_vector_is_zero(matrix->size, b)) {
        memset(x, 0, (size_t)matrix->size * sizeof *x);
        return DGFEM_OK;
    }
    work = desc->work;
    if (!work) work = (dgfem_real *)dgfemi_allocate(&desc->hooks, dgfem_pcg_work_size(matrix), sizeof(dgfem_real));
    if (!work) return dgfemi_fail_memory(&desc->hooks);
    status = dgfemi_pcg_solve(matrix, desc, b, x, work, &result);
    if (!desc->work) dgfemi_free(&desc->hooks, work);
    if (info) *info = result;
    if (status == DGFEM_ERROR_NOT_POSITIVE_DEFINITE)
        return dgfemi_fail(&desc->hooks, status, "pcg: diagonal block %d", result.failed_block);
    if (status)
        return dgfemi_fail(&desc->hooks, status, "pcg: residual %g after %d iterations", (double)result.residual,
                           result.iterations);
    return DGFEM_OK;
}

/* ==== locate.c ==================================================================================================== */

/* Which element of a mesh contains a point, or is nearest to it: winding numbers of elements, distances of faces, and
   buckets of element boxes that keep the search short. */

#define DGFEM_ON_FACE                                                                                                  \
    (DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-5) : DGFEM_R(1e-9)) /* of the radius: a point that near is on the face */

typedef struct dgfemi_locator {
    const dgfem_mesh *mesh;
    dgfem_vec3 *lower, *upper;          /* [element_count] boxes of the elements */
    dgfem_vec3 origin;                  /* lower corner of all buckets */
    dgfem_real cell;                    /* edge of a bucket */
    int size[3];                        /* buckets along x, y, z */
    int *bucket_start, *bucket_element; /* elements whose box meets the bucket, ascending */
    int *seen, stamp;                   /* [element_count] search that met the element last */
} dgfemi_locator;

typedef struct dgfemi_location {
    int element;         /* that contains the point, or the nearest one */
    dgfem_real distance; /* from the element; 0 inside */
    dgfem_vec3 nearest;  /* point of the element; the point itself inside */
} dgfemi_location;

static int dgfemi_locator_coordinate(const dgfemi_locator *locator, dgfem_vec3 x, int axis) {
    dgfem_real t = (dgfemi_axis(x, axis) - dgfemi_axis(locator->origin, axis)) / locator->cell;
    if (!(t > 0)) return 0;
    if (t >= (dgfem_real)locator->size[axis]) return locator->size[axis] - 1;
    return (int)t;
}

static int dgfemi_locator_bucket(const dgfemi_locator *locator, int i, int j, int k) {
    return i + locator->size[0] * (j + locator->size[1] * k);
}

/* The smallest buckets of which there are about two per element at most. */
static void dgfemi_locator_resolution(dgfemi_locator *locator, dgfem_vec3 extent) {
    double limit = 2.0 * (double)locator->mesh->element_count + 64.0;
    dgfem_real largest = dgfemi_max(extent.x, dgfemi_max(extent.y, extent.z));
    double room;
    locator->cell = largest / (dgfem_real)locator->mesh->element_count;
    do {
        locator->cell *= DGFEM_R(1.26);
        room = (floor((double)extent.x / (double)locator->cell) + 1) *
               (floor((double)extent.y / (double)locator->cell) + 1) *
               (floor((double)extent.z / (double)locator->cell) + 1);
    } while (room > limit);
    for (int axis = 0; axis < 3; axis++) locator->size[axis] = (int)(dgfemi_axis(extent, axis) / locator->cell) + 1;
}

/* For each bucket that the box of an element meets: counts the element (elements NULL) or enters it. */
static void dgfemi_locator_enter(const dgfemi_locator *locator, int element, int *counts, int *elements) {
    int first[3], last[3];
    for (int axis = 0; axis < 3; axis++) {
        first[axis] = dgfemi_locator_coordinate(locator, locator->lower[element], axis);
        last[axis] = dgfemi_locator_coordinate(locator, locator->upper[element], axis);
    }
    for (int k = first[2]; k <= last[2]; k++)
        for (int j = first[1]; j <= last[1]; j++)
            for (int i = first[0]; i <= last[0]; i++) {
                int bucket = dgfemi_locator_bucket(locator, i, j, k);
                if (elements) elements[counts[bucket]] = element;
                counts[bucket]++;
            }
}

/* 1 on success, 0 when out of memory. All memory is the arena's. */
static int dgfemi_locator_make(dgfemi_arena *arena, const dgfem_mesh *mesh, dgfemi_locator *locator) {
    size_t elements = (size_t)mesh->element_count;
    dgfem_vec3 upper;
    int buckets, total = 0;
    int *fill;
    memset(locator, 0, sizeof *locator);
    locator->mesh = mesh;
    locator->lower = (dgfem_vec3 *)dgfemi_arena_allocate(arena, elements, sizeof(dgfem_vec3));
    locator->upper = (dgfem_vec3 *)dgfemi_arena_allocate(arena, elements, sizeof(dgfem_vec3));
    locator->seen = (int *)dgfemi_arena_allocate_zero(arena, elements, sizeof(int));
    if (!locator->lower || !locator->upper || !locator->seen) return 0;
    for (int e = 0; e < mesh->element_count; e++)
        dgfemi_mesh_element_box(mesh, e, &locator->lower[e], &locator->upper[e]);
    locator->origin = locator->lower[0], upper = locator->upper[0];
    for (int e = 1; e < mesh->element_count; e++) {
        locator->origin = dgfemi_min3(locator->origin, locator->lower[e]);
        upper = dgfemi_max3(upper, locator->upper[e]);
    }
    dgfemi_locator_resolution(locator, dgfemi_sub(upper, locator->origin));
    buckets = locator->size[0] * locator->size[1] * locator->size[2];
    locator->bucket_start = (int *)dgfemi_arena_allocate_zero(arena, (size_t)buckets + 1, sizeof(int));
    fill = (int *)dgfemi_arena_allocate_zero(arena, (size_t)buckets, sizeof(int));
    if (!locator->bucket_start || !fill) return 0;
    for (int e = 0; e < mesh->element_count; e++) dgfemi_locator_enter(locator, e, fill, NULL);
    for (int b = 0; b < buckets; b++) {
        int count = fill[b];
        locator->bucket_start[b] = fill[b] = total;
        total += count;
    }
    locator->bucket_start[buckets] = total;
    locator->bucket_element = (int *)dgfemi_arena_allocate(arena, (size_t)total, sizeof(int));
    if (!locator->bucket_element) return 0;
    for (int e = 0; e < mesh->element_count; e++) dgfemi_locator_enter(locator, e, fill, locator->bucket_element);
    return 1;
}

/* ---- faces and elements ---- */

/* Whether a point of the face's plane lies in the face: parity of the crossings of a ray, seen along the axis on which
   the face is largest. */
static int dgfemi_face_covers(const dgfem_mesh *mesh, const dgfem_face *face, dgfem_vec3 x) {
    dgfem_real nx = dgfemi_abs(face->normal.x), ny = dgfemi_abs(face->normal.y), nz = dgfemi_abs(face->normal.z);
    int drop = nx >= ny && nx >= nz ? 0 : ny >= nz ? 1 : 2;
    int u = (drop + 1) % 3, v = (drop + 2) % 3, inside = 0;
    dgfem_real xu = dgfemi_axis(x, u), xv = dgfemi_axis(x, v);
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        int count = mesh->loops[l].count;
        for (int i = 0; i < count; i++) {
            dgfem_vec3 a = mesh->vertices[loop[i]], b = mesh->vertices[loop[i + 1 < count ? i + 1 : 0]];
            dgfem_real av = dgfemi_axis(a, v), bv = dgfemi_axis(b, v);
            if ((av > xv) == (bv > xv)) continue;
            if (xu < dgfemi_axis(a, u) + (xv - av) / (bv - av) * (dgfemi_axis(b, u) - dgfemi_axis(a, u)))
                inside = !inside;
        }
    }
    return inside;
}

static dgfem_vec3 dgfemi_nearest_on_segment(dgfem_vec3 a, dgfem_vec3 b, dgfem_vec3 x) {
    dgfem_vec3 d = dgfemi_sub(b, a);
    dgfem_real square = dgfemi_dot(d, d), t = dgfemi_dot(dgfemi_sub(x, a), d);
    if (!(t > 0)) return a;
    if (t >= square) return b;
    return dgfemi_add_scaled(a, t / square, d);
}

static dgfem_vec3 dgfemi_face_nearest(const dgfem_mesh *mesh, const dgfem_face *face, dgfem_vec3 x) {
    dgfem_real height = dgfemi_dot(face->normal, dgfemi_sub(x, face->centre)), best_distance = -1;
    dgfem_vec3 foot = dgfemi_add_scaled(x, -height, face->normal), best = foot;
    if (dgfemi_face_covers(mesh, face, foot)) return foot;
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        int count = mesh->loops[l].count;
        for (int i = 0; i < count; i++) {
            dgfem_vec3 p =
                dgfemi_nearest_on_segment(mesh->vertices[loop[i]], mesh->vertices[loop[i + 1 < count ? i + 1 : 0]], x);
            dgfem_real distance = dgfemi_distance(p, x);
            if (best_distance < 0 || distance < best_distance) best_distance = distance, best = p;
        }
    }
    return best;
}

/* Solid angle of the face as a fraction of the sphere, positive seen from behind its normal: the fans of its loops,
   each triangle by tan(angle / 2) = a.(b x c) / (|a||b||c| + (a.b)|c| + (b.c)|a| + (c.a)|b|). */
static double dgfemi_face_winding(const dgfem_mesh *mesh, const dgfem_face *face, dgfem_vec3 x) {
    double angle = 0;
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        dgfem_vec3 a = dgfemi_sub(mesh->vertices[loop[0]], x), b = dgfemi_sub(mesh->vertices[loop[1]], x);
        dgfem_real na = dgfemi_norm(a), nb = dgfemi_norm(b);
        for (int i = 2; i < mesh->loops[l].count; i++) {
            dgfem_vec3 c = dgfemi_sub(mesh->vertices[loop[i]], x);
            dgfem_real nc = dgfemi_norm(c);
            dgfem_real denominator =
                na * nb * nc + dgfemi_dot(a, b) * nc + dgfemi_dot(b, c) * na + dgfemi_dot(c, a) * nb;
            angle += 2 * atan2((double)dgfemi_dot(a, dgfemi_cross(b, c)), (double)denominator);
            b = c, nb = nc;
        }
    }
    return angle / 12.566370614359172;
}

/* 1 inside and on a face. In the plane of a face the solid angle is either zero or undefined: such a face is decided
   by whether it covers the point. */
static int dgfemi_element_contains(const dgfem_mesh *mesh, int element, dgfem_vec3 x) {
    const dgfem_element *e = &mesh->elements[element];
    double winding = 0;
    for (int k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        dgfem_real height = dgfemi_dot(face->normal, dgfemi_sub(x, face->centre));
        if (dgfemi_abs(height) > DGFEM_ON_FACE * e->radius)
            winding += dgfemi_mesh_sign(mesh, element, mesh->element_faces[k]) * dgfemi_face_winding(mesh, face, x);
        else if (dgfemi_face_covers(mesh, face, dgfemi_add_scaled(x, -height, face->normal))) return 1;
    }
    return winding > 0.5;
}

/* ---- search ---- */

static dgfem_real dgfemi_box_distance(dgfem_vec3 lower, dgfem_vec3 upper, dgfem_vec3 x) {
    dgfem_vec3 inside = dgfemi_min3(dgfemi_max3(x, lower), upper);
    return dgfemi_distance(inside, x);
}

/* Replaces the location by the element when that is nearer, or as near with a lower index. */
static void dgfemi_locator_try(const dgfemi_locator *locator, int element, dgfem_vec3 x, dgfemi_location *location) {
    const dgfem_mesh *mesh = locator->mesh;
    const dgfem_element *e = &mesh->elements[element];
    if (location->element != DGFEM_NONE &&
        dgfemi_box_distance(locator->lower[element], locator->upper[element], x) > location->distance)
        return;
    for (int k = e->face_start; k < e->face_start + e->face_count; k++) {
        dgfem_vec3 p = dgfemi_face_nearest(mesh, &mesh->faces[mesh->element_faces[k]], x);
        dgfem_real distance = dgfemi_distance(p, x);
        if (location->element == DGFEM_NONE || distance < location->distance ||
            (!(distance > location->distance) && element < location->element)) {
            location->element = element;
            location->distance = distance;
            location->nearest = p;
        }
    }
}

/* Tries the elements of all buckets whose largest difference of coordinates from `centre` is `ring`. */
static void dgfemi_locator_try_ring(dgfemi_locator *locator, const int centre[3], int ring, dgfem_vec3 x,
                                    dgfemi_location *location) {
    int first[3], last[3];
    for (int axis = 0; axis < 3; axis++) {
        first[axis] = centre[axis] > ring ? centre[axis] - ring : 0;
        last[axis] = centre[axis] + ring < locator->size[axis] ? centre[axis] + ring : locator->size[axis] - 1;
    }
    for (int k = first[2]; k <= last[2]; k++)
        for (int j = first[1]; j <= last[1]; j++) {
            int shell = abs(k - centre[2]) == ring || abs(j - centre[1]) == ring;
            for (int i = first[0]; i <= last[0]; i++) {
                int bucket = dgfemi_locator_bucket(locator, i, j, k);
                if (!shell && abs(i - centre[0]) != ring) continue;
                for (int n = locator->bucket_start[bucket]; n < locator->bucket_start[bucket + 1]; n++) {
                    int element = locator->bucket_element[n];
                    if (locator->seen[element] == locator->stamp) continue;
                    locator->seen[element] = locator->stamp;
                    dgfemi_locator_try(locator, element, x, location);
                }
            }
        }
}

/* The element with the lowest index that contains x, else the nearest one. */
static dgfemi_location dgfemi_locate(dgfemi_locator *locator, dgfem_vec3 x) {
    dgfemi_location location;
    dgfem_real margin = locator->cell;
    int centre[3], rings = 0, bucket;
    for (int axis = 0; axis < 3; axis++) {
        dgfem_real t = dgfemi_axis(x, axis) - dgfemi_axis(locator->origin, axis);
        centre[axis] = dgfemi_locator_coordinate(locator, x, axis);
        t -= (dgfem_real)centre[axis] * locator->cell;
        margin = dgfemi_max(0, dgfemi_min(margin, dgfemi_min(t, locator->cell - t)));
        if (locator->size[axis] > rings) rings = locator->size[axis];
    }
    bucket = dgfemi_locator_bucket(locator, centre[0], centre[1], centre[2]);
    location.distance = 0, location.nearest = x;
    for (int n = locator->bucket_start[bucket]; n < locator->bucket_start[bucket + 1]; n++) {
        int element = locator->bucket_element[n];
        location.element = element;
        if (!(dgfemi_box_distance(locator->lower[element], locator->upper[element], x) > 0) &&
            dgfemi_element_contains(locator->mesh, element, x))
            return location;
    }
    location.element = DGFEM_NONE;
    locator->stamp++;
    for (int ring = 0; ring <= rings; ring++) { /* further rings are at least margin + ring * cell away */
        dgfemi_locator_try_ring(locator, centre, ring, x, &location);
        if (location.element != DGFEM_NONE && location.distance < margin + (dgfem_real)ring * locator->cell) break;
    }
    DGFEM_ASSERT(location.element != DGFEM_NONE);
    return location;
}

/* ==== embed.c ===================================================================================================== */

/* Embedding of points in a body by moving least squares (MLS), eq. (30)-(32).

   Samples are the centres of the elements and a thinned set of the stitched corners. A point's displacement is the
   value at x of the affine function that fits the samples' displacements best in the sense of
     sum_k theta_k |a(x_k) - u_k|^2,   theta = exp(-2 q^2) (1 - q^2)^3,   q = |x - x_k| / R_k < 1,
   a window that is C2 at its edge. In terms of weighted means (W = sum theta_k, m = sum theta_k x_k / W,
   C = sum theta_k (x_k - m)(x_k - m)^T) the weight of sample k is
     phi_k(x) = theta_k (1/W + (x_k - m)^T C^-1 (x - m)),   sum phi_k = 1,   sum phi_k x_k = x.

   A sample reaches a point only through glued elements. Where the straight way is blocked (between two ears, across a
   cut) the distance to the elements that have to be passed counts instead, so that weights vanish continuously:

        .-----.     .-----.          x: the point, s: a sample in the other arm
        |  x  |     |  s  |          path: down through the bridge B and up again
        |     '-----'     |          q = max(|x - s|, distance(x, B)) / R_s
        |        B        |
        '-----------------'  */

/* ---- samples: element centres and thinned corners ---- */

#define DGFEM_THINNING DGFEM_R(0.3) /* of the mean radius: a corner that near to a kept sample of its elements may go */
#define DGFEM_MIN_ELEMENT_SAMPLES 5 /* each element keeps at least so many samples, its centre included */
#define DGFEM_SPREAD DGFEM_R(0.05)  /* and at least this part of the smallest principal moment of all its corners */

typedef struct dgfemi_thinning {
    const dgfem_mesh *mesh;
    const dgfem_corners *corners;
    int *kept;        /* [corners] */
    int *corner_of;   /* [incidences]: corner of each entry of corners->elements */
    int *head, *next; /* the kept corners of each element, chained through the incidences */
} dgfemi_thinning;

static dgfem_vec3 dgfemi_corner_position(const dgfemi_thinning *thinning, int corner) {
    return thinning->mesh->vertices[thinning->corners->vertex[corner]];
}

static dgfem_real dgfemi_mean_radius(const dgfem_mesh *mesh, const int *elements, int count) {
    dgfem_real sum = 0;
    for (int i = 0; i < count; i++) sum += mesh->elements[elements[i]].radius;
    return sum / (dgfem_real)count;
}

static void dgfemi_thinning_keep(dgfemi_thinning *thinning, int corner) {
    thinning->kept[corner] = 1;
    for (int i = thinning->corners->element_start[corner]; i < thinning->corners->element_start[corner + 1]; i++) {
        int element = thinning->corners->elements[i];
        thinning->next[i] = thinning->head[element];
        thinning->head[element] = i;
    }
}

/* Distance from x to the nearest kept sample of the element. */
static dgfem_real dgfemi_thinning_distance(const dgfemi_thinning *thinning, int element, dgfem_vec3 x) {
    dgfem_real distance = dgfemi_distance(x, thinning->mesh->elements[element].centre);
    for (int i = thinning->head[element]; i != DGFEM_NONE; i = thinning->next[i])
        distance = dgfemi_min(distance, dgfemi_distance(x, dgfemi_corner_position(thinning, thinning->corner_of[i])));
    return distance;
}

static int dgfemi_thinning_is_redundant(const dgfemi_thinning *thinning, int corner) {
    const dgfem_corners *corners = thinning->corners;
    int first = corners->element_start[corner], last = corners->element_start[corner + 1];
    dgfem_real limit = DGFEM_THINNING * dgfemi_mean_radius(thinning->mesh, corners->elements + first, last - first);
    dgfem_vec3 x = dgfemi_corner_position(thinning, corner);
    for (int i = first; i < last; i++)
        if (dgfemi_thinning_distance(thinning, corners->elements[i], x) < limit) return 1;
    return 0;
}

static dgfem_real dgfemi_smallest_moment(const dgfem_mat3 *scatter, int count) {
    dgfem_real values[3];
    dgfem_mat3 axes;
    dgfem_eigen_symmetric(*scatter, values, &axes);
    return values[0] / (dgfem_real)count;
}

/* Whether the kept samples of the element are enough, and as far from coplanar as the element's corners allow. */
static int dgfemi_thinning_suffices(const dgfemi_thinning *thinning, int element) {
    const dgfem_corners *corners = thinning->corners;
    dgfem_vec3 centre = thinning->mesh->elements[element].centre;
    dgfem_mat3 kept, all;
    int kept_count = 1, all_count = 1; /* the centre */
    memset(&kept, 0, sizeof kept);
    memset(&all, 0, sizeof all);
    for (int i = corners->corner_start[element]; i < corners->corner_start[element + 1]; i++) {
        dgfem_vec3 d = dgfemi_sub(dgfemi_corner_position(thinning, corners->corners[i]), centre);
        dgfemi_add_outer(&all, 1, d, d);
        all_count++;
        if (!thinning->kept[corners->corners[i]]) continue;
        dgfemi_add_outer(&kept, 1, d, d);
        kept_count++;
    }
    return kept_count == all_count ||
           (kept_count >= DGFEM_MIN_ELEMENT_SAMPLES &&
            dgfemi_smallest_moment(&kept, kept_count) >= DGFEM_SPREAD * dgfemi_smallest_moment(&all, all_count));
}

/* Keeps the corner of the element that is farthest from all its kept samples. */
static void dgfemi_thinning_keep_farthest(dgfemi_thinning *thinning, int element) {
    const dgfem_corners *corners = thinning->corners;
    dgfem_real largest = -1;
    int farthest = DGFEM_NONE;
    for (int i = corners->corner_start[element]; i < corners->corner_start[element + 1]; i++) {
        int corner = corners->corners[i];
        dgfem_real distance;
        if (thinning->kept[corner]) continue;
        distance = dgfemi_thinning_distance(thinning, element, dgfemi_corner_position(thinning, corner));
        if (distance > largest) largest = distance, farthest = corner;
    }
    DGFEM_ASSERT(farthest != DGFEM_NONE);
    dgfemi_thinning_keep(thinning, farthest);
}

/* Corners by number of incident elements, descending, then by index (counting sort). 1 on success. */
static int dgfemi_thinning_order(dgfemi_arena *arena, const dgfem_corners *corners, int *order) {
    int most = 0, position = 0;
    int *start;
    for (int c = 0; c < corners->count; c++) {
        int count = corners->element_start[c + 1] - corners->element_start[c];
        if (count > most) most = count;
    }
    start = (int *)dgfemi_arena_allocate_zero(arena, (size_t)most + 1, sizeof(int));
    if (!start) return 0;
    for (int c = 0; c < corners->count; c++) start[corners->element_start[c + 1] - corners->element_start[c]]++;
    for (int n = most; n >= 0; n--) {
        int count = start[n];
        start[n] = position;
        position += count;
    }
    for (int c = 0; c < corners->count; c++)
        order[start[corners->element_start[c + 1] - corners->element_start[c]]++] = c;
    return 1;
}

/* Which corners become samples. 1 on success, 0 when out of memory. */
static int dgfemi_thin_corners(dgfemi_arena *arena, const dgfem_mesh *mesh, const dgfem_corners *corners, int **kept) {
    size_t incidences = (size_t)corners->element_start[corners->count];
    dgfemi_thinning thinning;
    int *order = (int *)dgfemi_arena_allocate(arena, (size_t)corners->count, sizeof(int));
    thinning.mesh = mesh, thinning.corners = corners;
    thinning.kept = (int *)dgfemi_arena_allocate_zero(arena, (size_t)corners->count, sizeof(int));
    thinning.corner_of = (int *)dgfemi_arena_allocate(arena, incidences, sizeof(int));
    thinning.next = (int *)dgfemi_arena_allocate(arena, incidences, sizeof(int));
    thinning.head = (int *)dgfemi_arena_allocate(arena, (size_t)mesh->element_count, sizeof(int));
    if (!order || !thinning.kept || !thinning.corner_of || !thinning.next || !thinning.head) return 0;
    if (!dgfemi_thinning_order(arena, corners, order)) return 0;
    for (int e = 0; e < mesh->element_count; e++) thinning.head[e] = DGFEM_NONE;
    for (int c = 0; c < corners->count; c++)
        for (int i = corners->element_start[c]; i < corners->element_start[c + 1]; i++) thinning.corner_of[i] = c;
    for (int i = 0; i < corners->count; i++)
        if (!dgfemi_thinning_is_redundant(&thinning, order[i])) dgfemi_thinning_keep(&thinning, order[i]);
    for (int e = 0; e < mesh->element_count; e++)
        while (!dgfemi_thinning_suffices(&thinning, e)) dgfemi_thinning_keep_farthest(&thinning, e);
    *kept = thinning.kept;
    return 1;
}

/* Sets samples and terms: sample k, at positions[k], averages the polynomials of elements[start[k] .. start[k + 1]). */
static int dgfemi_embedding_set_samples(dgfem_embedding *embedding, const dgfem_body *body, const dgfem_vec3 *positions,
                                        const int *start, const int *elements, int count) {
    const dgfem_hooks *hooks = &embedding->hooks;
    int terms = start[count], basis = 0;
    embedding->sample_count = count;
    embedding->samples = (dgfem_vec3 *)dgfemi_duplicate(hooks, positions, (size_t)count, sizeof(dgfem_vec3));
    embedding->term_start = (int *)dgfemi_duplicate(hooks, start, (size_t)count + 1, sizeof(int));
    embedding->term_element = (int *)dgfemi_duplicate(hooks, elements, (size_t)terms, sizeof(int));
    embedding->term_basis_start = (int *)dgfemi_allocate(hooks, (size_t)terms + 1, sizeof(int));
    if (!embedding->samples || !embedding->term_start || !embedding->term_element || !embedding->term_basis_start)
        return 0;
    for (int t = 0; t < terms; t++) {
        embedding->term_basis_start[t] = basis;
        basis += dgfem_monomial_count(body->degree[elements[t]]);
    }
    embedding->term_basis_start[terms] = basis;
    embedding->term_basis = (dgfem_real *)dgfemi_allocate(hooks, (size_t)basis, sizeof(dgfem_real));
    if (!embedding->term_basis) return 0;
    for (int k = 0; k < count; k++)
        for (int t = start[k]; t < start[k + 1]; t++) {
            int e = elements[t];
            dgfemi_basis_evaluate(body->degree[e], body->origin[e], body->scale[e], positions[k],
                                  embedding->term_basis + embedding->term_basis_start[t]);
        }
    return 1;
}

/* Samples of an embedding: first the centre of each element, then the kept corners. 1 on success. */
static int dgfemi_embedding_choose_samples(dgfemi_arena *arena, dgfem_embedding *embedding, const dgfem_body *body,
                                           const dgfem_corners *corners) {
    const dgfem_mesh *mesh = body->mesh;
    int count = mesh->element_count, terms = mesh->element_count;
    dgfem_vec3 *positions;
    int *start, *elements, *kept;
    if (!dgfemi_thin_corners(arena, mesh, corners, &kept)) return 0;
    for (int c = 0; c < corners->count; c++)
        if (kept[c]) count++, terms += corners->element_start[c + 1] - corners->element_start[c];
    positions = (dgfem_vec3 *)dgfemi_arena_allocate(arena, (size_t)count, sizeof(dgfem_vec3));
    start = (int *)dgfemi_arena_allocate(arena, (size_t)count + 1, sizeof(int));
    elements = (int *)dgfemi_arena_allocate(arena, (size_t)terms, sizeof(int));
    if (!positions || !start || !elements) return 0;
    for (int e = 0; e < mesh->element_count; e++) positions[e] = mesh->elements[e].centre, start[e] = elements[e] = e;
    count = terms = mesh->element_count;
    for (int c = 0; c < corners->count; c++) {
        if (!kept[c]) continue;
        positions[count] = mesh->vertices[corners->vertex[c]];
        start[count++] = terms;
        for (int i = corners->element_start[c]; i < corners->element_start[c + 1]; i++)
            elements[terms++] = corners->elements[i];
    }
    start[count] = terms;
    return dgfemi_embedding_set_samples(embedding, body, positions, start, elements, count);
}

/* ---- reach: how far samples see, and through which elements ---- */

#define DGFEM_WINDOW DGFEM_R(2.309401076758503) /* R_k / mean radius: two edges of a cube */
#define DGFEM_ENLARGE DGFEM_R(1.25)
#define DGFEM_MIN_POINT_SAMPLES 8
#define DGFEM_MAX_CONDITION DGFEM_R(1e4) /* of C; a larger one enlarges the windows */
#define DGFEM_CONDITION_ROUNDS 4         /* but only so often: a thin plate has no better one to offer */
#define DGFEM_MAX_ROUNDS 64
#define DGFEM_OUTSIDE DGFEM_R(0.5) /* of the radius: windows are not evaluated farther outside an element */

typedef struct dgfemi_sampling {
    const dgfem_mesh *mesh;
    const dgfem_embedding *embedding; /* its samples and terms are set */
    const dgfemi_locator *locator;
    int *element_start, *element_sample; /* samples of each element, ascending */
    int *neighbour_start, *neighbour;    /* glued neighbours of each element */
    dgfem_real *radius;                  /* [samples] R_k */
    dgfem_real *reach;                   /* [elements] largest R_k of the samples that may see through the element */
    int *component;                      /* [elements] glued component */
    int *component_samples;              /* [components] number of samples */
    int *mark, stamp;                    /* [elements] flood that met the element last */
    int *stack;                          /* [elements] */
} dgfemi_sampling;

static dgfem_real dgfemi_sampling_distance(const dgfemi_sampling *sampling, int element, dgfem_vec3 x) {
    return dgfemi_box_distance(sampling->locator->lower[element], sampling->locator->upper[element], x);
}

static void dgfemi_sampling_components(dgfemi_sampling *sampling) {
    const dgfem_mesh *mesh = sampling->mesh;
    int components = 0;
    for (int e = 0; e < mesh->element_count; e++) sampling->component[e] = DGFEM_NONE;
    for (int seed = 0; seed < mesh->element_count; seed++) {
        int depth = 0;
        if (sampling->component[seed] != DGFEM_NONE) continue;
        sampling->component[seed] = components;
        sampling->stack[depth++] = seed;
        while (depth > 0) {
            int e = sampling->stack[--depth];
            for (int k = sampling->neighbour_start[e]; k < sampling->neighbour_start[e + 1]; k++) {
                int neighbour = sampling->neighbour[k];
                if (sampling->component[neighbour] != DGFEM_NONE) continue;
                sampling->component[neighbour] = components;
                sampling->stack[depth++] = neighbour;
            }
        }
        components++;
    }
    for (int i = 0; i < components; i++) sampling->component_samples[i] = 0;
    for (int s = 0; s < sampling->embedding->sample_count; s++) {
        int element = sampling->embedding->term_element[sampling->embedding->term_start[s]];
        sampling->component_samples[sampling->component[element]]++;
    }
}

/* Lists the samples of each element from the elements of each sample; `fill` is zero. */
static void dgfemi_sampling_incidence(dgfemi_sampling *sampling, int *fill) {
    const dgfem_embedding *embedding = sampling->embedding;
    int total = 0;
    for (int t = 0; t < embedding->term_start[embedding->sample_count]; t++) fill[embedding->term_element[t]]++;
    for (int e = 0; e < sampling->mesh->element_count; e++) {
        int count = fill[e];
        sampling->element_start[e] = fill[e] = total;
        total += count;
    }
    sampling->element_start[sampling->mesh->element_count] = total;
    for (int s = 0; s < embedding->sample_count; s++)
        for (int t = embedding->term_start[s]; t < embedding->term_start[s + 1]; t++)
            sampling->element_sample[fill[embedding->term_element[t]]++] = s;
}

/* Lists the glued neighbours of each element: none at the boundary and behind a cut. `fill` is zero. */
static void dgfemi_sampling_neighbours(dgfemi_sampling *sampling, int *fill) {
    const dgfem_mesh *mesh = sampling->mesh;
    int total = 0;
    for (int pass = 0; pass < 2; pass++) {
        for (int f = 0; f < mesh->face_count; f++) {
            int a = mesh->faces[f].element[0], b = mesh->faces[f].element[1];
            if (b == DGFEM_NONE || mesh->faces[f].cut) continue;
            if (pass == 1) sampling->neighbour[fill[a]] = b, sampling->neighbour[fill[b]] = a;
            fill[a]++, fill[b]++;
        }
        for (int e = 0; pass == 0 && e < mesh->element_count; e++) {
            int count = fill[e];
            sampling->neighbour_start[e] = fill[e] = total;
            total += count;
        }
    }
    sampling->neighbour_start[mesh->element_count] = total;
}

/* Marks with a sample's radius every element that the sample may see through: connected to it within that radius. */
static void dgfemi_sampling_flood(dgfemi_sampling *sampling, int sample) {
    const dgfem_embedding *embedding = sampling->embedding;
    dgfem_real radius = sampling->radius[sample];
    int depth = 0;
    sampling->stamp++;
    for (int t = embedding->term_start[sample]; t < embedding->term_start[sample + 1]; t++) {
        sampling->mark[embedding->term_element[t]] = sampling->stamp;
        sampling->stack[depth++] = embedding->term_element[t];
    }
    while (depth > 0) {
        int e = sampling->stack[--depth];
        sampling->reach[e] = dgfemi_max(sampling->reach[e], radius);
        for (int k = sampling->neighbour_start[e]; k < sampling->neighbour_start[e + 1]; k++) {
            int neighbour = sampling->neighbour[k];
            if (sampling->mark[neighbour] == sampling->stamp) continue;
            if (!(dgfemi_sampling_distance(sampling, neighbour, embedding->samples[sample]) < radius)) continue;
            sampling->mark[neighbour] = sampling->stamp;
            sampling->stack[depth++] = neighbour;
        }
    }
}

static void dgfemi_sampling_update_reach(dgfemi_sampling *sampling) {
    for (int e = 0; e < sampling->mesh->element_count; e++) sampling->reach[e] = 0;
    for (int s = 0; s < sampling->embedding->sample_count; s++) dgfemi_sampling_flood(sampling, s);
}

/* 1 on success, 0 when out of memory. */
static int dgfemi_sampling_make(dgfemi_arena *arena, const dgfem_mesh *mesh, const dgfem_embedding *embedding,
                                const dgfemi_locator *locator, dgfemi_sampling *sampling) {
    size_t elements = (size_t)mesh->element_count, terms = (size_t)embedding->term_start[embedding->sample_count];
    int *fill = (int *)dgfemi_arena_allocate_zero(arena, 2 * elements, sizeof(int));
    memset(sampling, 0, sizeof *sampling);
    sampling->mesh = mesh, sampling->embedding = embedding, sampling->locator = locator;
    sampling->element_start = (int *)dgfemi_arena_allocate(arena, elements + 1, sizeof(int));
    sampling->element_sample = (int *)dgfemi_arena_allocate(arena, terms, sizeof(int));
    sampling->neighbour_start = (int *)dgfemi_arena_allocate(arena, elements + 1, sizeof(int));
    sampling->neighbour = (int *)dgfemi_arena_allocate(arena, 2 * (size_t)mesh->face_count, sizeof(int));
    sampling->radius = (dgfem_real *)dgfemi_arena_allocate(arena, (size_t)embedding->sample_count, sizeof(dgfem_real));
    sampling->reach = (dgfem_real *)dgfemi_arena_allocate(arena, elements, sizeof(dgfem_real));
    sampling->component = (int *)dgfemi_arena_allocate(arena, elements, sizeof(int));
    sampling->component_samples = (int *)dgfemi_arena_allocate(arena, elements, sizeof(int));
    sampling->mark = (int *)dgfemi_arena_allocate_zero(arena, elements, sizeof(int));
    sampling->stack = (int *)dgfemi_arena_allocate(arena, elements, sizeof(int));
    if (!fill || !sampling->element_start || !sampling->element_sample || !sampling->neighbour_start ||
        !sampling->neighbour || !sampling->radius || !sampling->reach || !sampling->component ||
        !sampling->component_samples || !sampling->mark || !sampling->stack)
        return 0;
    dgfemi_sampling_incidence(sampling, fill);
    dgfemi_sampling_neighbours(sampling, fill + mesh->element_count);
    dgfemi_sampling_components(sampling);
    for (int s = 0; s < embedding->sample_count; s++) {
        int first = embedding->term_start[s], count = embedding->term_start[s + 1] - first;
        sampling->radius[s] = DGFEM_WINDOW * dgfemi_mean_radius(mesh, embedding->term_element + first, count);
    }
    dgfemi_sampling_update_reach(sampling);
    return 1;
}

/* ---- query: the samples that reach a point ---- */

typedef struct dgfemi_query {
    dgfemi_sampling *sampling;
    int *element_mark, *sample_mark, stamp; /* query that met the element, the sample last */
    dgfem_real *way; /* [elements] distance of the farthest element that must be passed to get there, itself included */
    int *heap;       /* [elements] elements to visit, the one with the shortest way on top */
    int heap_count;
    int *visited; /* [elements] in the order of their ways */
    int visited_count;
    int *sample;        /* [samples] that reach the point */
    dgfem_real *theta;  /* [samples] their windows */
    dgfem_real *weight; /* [samples] their weights */
    int count;
} dgfemi_query;

static int dgfemi_query_make(dgfemi_arena *arena, dgfemi_sampling *sampling, dgfemi_query *query) {
    size_t elements = (size_t)sampling->mesh->element_count, samples = (size_t)sampling->embedding->sample_count;
    memset(query, 0, sizeof *query);
    query->sampling = sampling;
    query->element_mark = (int *)dgfemi_arena_allocate_zero(arena, elements, sizeof(int));
    query->sample_mark = (int *)dgfemi_arena_allocate_zero(arena, samples, sizeof(int));
    query->way = (dgfem_real *)dgfemi_arena_allocate(arena, elements, sizeof(dgfem_real));
    query->heap = (int *)dgfemi_arena_allocate(arena, elements, sizeof(int));
    query->visited = (int *)dgfemi_arena_allocate(arena, elements, sizeof(int));
    query->sample = (int *)dgfemi_arena_allocate(arena, samples, sizeof(int));
    query->theta = (dgfem_real *)dgfemi_arena_allocate(arena, samples, sizeof(dgfem_real));
    query->weight = (dgfem_real *)dgfemi_arena_allocate(arena, samples, sizeof(dgfem_real));
    return query->element_mark && query->sample_mark && query->way && query->heap && query->visited && query->sample &&
           query->theta && query->weight;
}

/* Shorter way first, then lower index: one order, whatever the history of the heap. */
static int dgfemi_query_before(const dgfemi_query *query, int a, int b) {
    if (query->way[a] < query->way[b]) return 1;
    return !(query->way[b] < query->way[a]) && a < b;
}

static void dgfemi_query_push(dgfemi_query *query, int element, dgfem_real way) {
    int i = query->heap_count++;
    query->element_mark[element] = query->stamp;
    query->way[element] = way;
    while (i > 0 && dgfemi_query_before(query, element, query->heap[(i - 1) / 2])) {
        query->heap[i] = query->heap[(i - 1) / 2];
        i = (i - 1) / 2;
    }
    query->heap[i] = element;
}

static int dgfemi_query_pop(dgfemi_query *query) {
    int top = query->heap[0], last = query->heap[--query->heap_count], i = 0;
    for (;;) {
        int child = 2 * i + 1;
        if (child >= query->heap_count) break;
        if (child + 1 < query->heap_count && dgfemi_query_before(query, query->heap[child + 1], query->heap[child]))
            child++;
        if (!dgfemi_query_before(query, query->heap[child], last)) break;
        query->heap[i] = query->heap[child];
        i = child;
    }
    query->heap[i] = last;
    return top;
}

static dgfem_real dgfemi_window(dgfem_real q) {
    dgfem_real square = q * q, rest = 1 - square;
    return (dgfem_real)exp(-2 * (double)square) * rest * rest * rest;
}

/* Accepts the samples of an element just visited. The first visit of a sample comes by its shortest way. */
static void dgfemi_query_accept(dgfemi_query *query, int element, dgfem_vec3 x) {
    const dgfemi_sampling *sampling = query->sampling;
    for (int i = sampling->element_start[element]; i < sampling->element_start[element + 1]; i++) {
        int s = sampling->element_sample[i];
        dgfem_real distance;
        if (query->sample_mark[s] == query->stamp) continue;
        query->sample_mark[s] = query->stamp;
        distance = dgfemi_max(query->way[element], dgfemi_distance(sampling->embedding->samples[s], x));
        if (!(distance < sampling->radius[s])) continue;
        query->theta[query->count] = dgfemi_window(distance / sampling->radius[s]);
        query->sample[query->count++] = s;
    }
}

/* Finds the samples that reach x from the element `home`: elements are visited in the order of their ways, the way of a
   neighbour being max(way, distance from x to the neighbour's box). */
static void dgfemi_query_run(dgfemi_query *query, int home, dgfem_vec3 x) {
    const dgfemi_sampling *sampling = query->sampling;
    query->stamp++;
    query->count = query->heap_count = query->visited_count = 0;
    dgfemi_query_push(query, home, 0);
    while (query->heap_count > 0) {
        int e = dgfemi_query_pop(query);
        query->visited[query->visited_count++] = e;
        dgfemi_query_accept(query, e, x);
        for (int k = sampling->neighbour_start[e]; k < sampling->neighbour_start[e + 1]; k++) {
            int neighbour = sampling->neighbour[k];
            dgfem_real way;
            if (query->element_mark[neighbour] == query->stamp) continue;
            way = dgfemi_max(query->way[e], dgfemi_sampling_distance(sampling, neighbour, x));
            if (way < sampling->reach[neighbour]) dgfemi_query_push(query, neighbour, way);
        }
    }
}

/* ---- weights ---- */

/* Weighted means of the samples that reach x, relative to x. */
typedef struct dgfemi_fit {
    dgfem_real weight;    /* W */
    dgfem_vec3 mean;      /* m - x */
    dgfem_real moment[3]; /* eigenvalues of C, ascending, */
    dgfem_mat3 axes;      /* and its eigenvectors */
} dgfemi_fit;

#define DGFEM_FLAT                                                                                                     \
    (DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-6) : DGFEM_R(1e-12)) /* of the largest moment: smaller is round-off */

static dgfem_vec3 dgfemi_query_offset(const dgfemi_query *query, int i, dgfem_vec3 x) {
    return dgfemi_sub(query->sampling->embedding->samples[query->sample[i]], x);
}

static void dgfemi_query_fit(const dgfemi_query *query, dgfem_vec3 x, dgfemi_fit *fit) {
    dgfem_mat3 c;
    memset(fit, 0, sizeof *fit);
    for (int i = 0; i < query->count; i++) {
        fit->weight += query->theta[i];
        fit->mean = dgfemi_add_scaled(fit->mean, query->theta[i], dgfemi_query_offset(query, i, x));
    }
    if (!(fit->weight > 0)) return;
    fit->mean = dgfemi_scale(1 / fit->weight, fit->mean);
    memset(&c, 0, sizeof c);
    for (int i = 0; i < query->count; i++) {
        dgfem_vec3 d = dgfemi_sub(dgfemi_query_offset(query, i, x), fit->mean);
        dgfemi_add_outer(&c, query->theta[i], d, d);
    }
    dgfem_eigen_symmetric(c, fit->moment, &fit->axes);
}

static int dgfemi_fit_is_flat(const dgfemi_fit *fit) { return !(fit->moment[0] > DGFEM_FLAT * fit->moment[2]); }

/* C^-1 v; directions in which the samples do not spread are left out. */
static dgfem_vec3 dgfemi_fit_solve(const dgfemi_fit *fit, dgfem_vec3 v) {
    dgfem_vec3 result = dgfemi_vec3(0, 0, 0);
    for (int i = 0; i < 3; i++) {
        dgfem_vec3 axis = dgfemi_column(&fit->axes, i);
        if (!(fit->moment[i] > DGFEM_FLAT * fit->moment[2])) continue;
        result = dgfemi_add_scaled(result, dgfemi_dot(axis, v) / fit->moment[i], axis);
    }
    return result;
}

/* Adds theta_k (value / W + (x_k - m)^T C^-1 slope) to the weights: sum phi grows by `value`, and sum phi (x_k - m) by
   `slope`. */
static void dgfemi_query_add_weights(dgfemi_query *query, const dgfemi_fit *fit, dgfem_vec3 x, dgfem_real value,
                                     dgfem_vec3 slope) {
    dgfem_vec3 z = dgfemi_fit_solve(fit, slope);
    for (int i = 0; i < query->count; i++) {
        dgfem_vec3 d = dgfemi_sub(dgfemi_query_offset(query, i, x), fit->mean);
        query->weight[i] += query->theta[i] * (value / fit->weight + dgfemi_dot(d, z));
    }
}

/* Weights at x from the windows in theta. What round-off has left of sum phi = 1 and sum phi (x_k - x) = 0 is put right
   by the same formula. */
static void dgfemi_query_weights(dgfemi_query *query, const dgfemi_fit *fit, dgfem_vec3 x) {
    dgfem_vec3 first = dgfemi_vec3(0, 0, 0);
    dgfem_real sum = 0;
    for (int i = 0; i < query->count; i++) query->weight[i] = 0;
    dgfemi_query_add_weights(query, fit, x, 1, dgfemi_scale(-1, fit->mean));
    for (int i = 0; i < query->count; i++) {
        sum += query->weight[i];
        first = dgfemi_add_scaled(first, query->weight[i], dgfemi_query_offset(query, i, x));
    }
    dgfemi_query_add_weights(query, fit, x, 1 - sum, dgfemi_add_scaled(dgfemi_scale(-1, first), -(1 - sum), fit->mean));
}

/* All samples of one element, alike. */
static void dgfemi_query_take_element(dgfemi_query *query, int element) {
    const dgfemi_sampling *sampling = query->sampling;
    query->count = 0;
    for (int i = sampling->element_start[element]; i < sampling->element_start[element + 1]; i++) {
        query->theta[query->count] = 1;
        query->sample[query->count++] = sampling->element_sample[i];
    }
}

/* Windows relative to the largest one, so that far samples alone do as well as near ones; those below round-off go. */
static void dgfemi_query_normalize(dgfemi_query *query) {
    dgfem_real largest = 0;
    int kept = 0;
    for (int i = 0; i < query->count; i++) largest = dgfemi_max(largest, query->theta[i]);
    for (int i = 0; i < query->count; i++) {
        dgfem_real theta = query->theta[i] / largest;
        if (!(theta > 0)) continue;
        query->theta[kept] = theta;
        query->sample[kept++] = query->sample[i];
    }
    query->count = kept;
}

/* Samples in ascending order: points that share samples read them alike. Insertion sort of some fifty. */
static void dgfemi_query_sort(dgfemi_query *query) {
    for (int i = 1; i < query->count; i++) {
        int sample = query->sample[i], j = i;
        dgfem_real theta = query->theta[i];
        for (; j > 0 && query->sample[j - 1] > sample; j--) {
            query->sample[j] = query->sample[j - 1];
            query->theta[j] = query->theta[j - 1];
        }
        query->sample[j] = sample;
        query->theta[j] = theta;
    }
}

/* ---- the embedding of points ---- */

/* Where the windows of a point are evaluated: at the point, but not far outside its element. The affine fit extends to
   the point itself, so linear fields are reproduced wherever it is. */
static dgfem_vec3 dgfemi_window_position(const dgfem_mesh *mesh, const dgfemi_location *location, dgfem_vec3 x) {
    dgfem_real limit = DGFEM_OUTSIDE * mesh->elements[location->element].radius;
    if (!(location->distance > limit)) return x;
    return dgfemi_add_scaled(location->nearest, limit / location->distance, dgfemi_sub(x, location->nearest));
}

/* Whether the samples that reach x, `round` enlargements on, determine the fit. */
static int dgfemi_query_is_served(const dgfemi_query *query, int home, dgfem_vec3 x, int round) {
    const dgfemi_sampling *sampling = query->sampling;
    dgfemi_fit fit;
    if (query->count == sampling->component_samples[sampling->component[home]]) return 1; /* there are no more */
    if (query->count < DGFEM_MIN_POINT_SAMPLES) return 0;
    if (round >= DGFEM_CONDITION_ROUNDS) return 1;
    dgfemi_query_fit(query, x, &fit);
    return fit.moment[0] * DGFEM_MAX_CONDITION > fit.moment[2];
}

static void dgfemi_mark_samples(const dgfemi_sampling *sampling, int element, char *enlarge) {
    for (int i = sampling->element_start[element]; i < sampling->element_start[element + 1]; i++)
        enlarge[sampling->element_sample[i]] = 1;
}

/* Marks the samples of the elements that the query has visited and of their neighbours. */
static void dgfemi_query_mark(const dgfemi_query *query, char *enlarge) {
    const dgfemi_sampling *sampling = query->sampling;
    for (int i = 0; i < query->visited_count; i++) {
        int e = query->visited[i];
        dgfemi_mark_samples(sampling, e, enlarge);
        for (int k = sampling->neighbour_start[e]; k < sampling->neighbour_start[e + 1]; k++)
            dgfemi_mark_samples(sampling, sampling->neighbour[k], enlarge);
    }
}

/* Enlarges the windows of the samples around poorly served points, once per round, until all points are served. `open`
   marks the points still to be looked at, `enlarge` the samples. */
static void dgfemi_enlarge_windows(dgfemi_query *query, const dgfem_embedding *embedding, const dgfem_vec3 *windows,
                                   char *open, char *enlarge) {
    dgfemi_sampling *sampling = query->sampling;
    memset(open, 1, (size_t)embedding->point_count);
    for (int round = 0; round < DGFEM_MAX_ROUNDS; round++) {
        int poor = 0;
        memset(enlarge, 0, (size_t)embedding->sample_count);
        for (int p = 0; p < embedding->point_count; p++) {
            if (!open[p]) continue;
            dgfemi_query_run(query, embedding->point_element[p], windows[p]);
            open[p] = !dgfemi_query_is_served(query, embedding->point_element[p], windows[p], round);
            if (!open[p]) continue;
            poor++;
            dgfemi_query_mark(query, enlarge);
        }
        if (poor == 0) return;
        for (int s = 0; s < embedding->sample_count; s++)
            if (enlarge[s]) sampling->radius[s] *= DGFEM_ENLARGE;
        dgfemi_sampling_update_reach(sampling);
    }
}

/* Appends the query's samples and weights as those of the next point. 1 on success. */
static int dgfemi_embedding_append(dgfem_embedding *embedding, const dgfemi_query *query, int point,
                                   int *sample_capacity, int *weight_capacity) {
    int first = embedding->weight_start[point], needed = first + query->count;
    if (query->count > INT_MAX - first) return 0;
    if (needed > *sample_capacity) {
        void *grown = dgfemi_grow(&embedding->hooks, embedding->weight_sample, sample_capacity, needed, sizeof(int));
        if (!grown) return 0;
        embedding->weight_sample = (int *)grown;
    }
    if (needed > *weight_capacity) {
        void *grown = dgfemi_grow(&embedding->hooks, embedding->weight, weight_capacity, needed, sizeof(dgfem_real));
        if (!grown) return 0;
        embedding->weight = (dgfem_real *)grown;
    }
    memcpy(embedding->weight_sample + first, query->sample, (size_t)query->count * sizeof(int));
    memcpy(embedding->weight + first, query->weight, (size_t)query->count * sizeof(dgfem_real));
    embedding->weight_start[point + 1] = needed;
    return 1;
}

/* Weights of all points. 1 on success, 0 when out of memory. */
static int dgfemi_embedding_weigh(dgfemi_query *query, dgfem_embedding *embedding, const dgfem_vec3 *windows) {
    int sample_capacity = 0, weight_capacity = 0;
    embedding->weight_start[0] = 0;
    for (int p = 0; p < embedding->point_count; p++) {
        dgfemi_fit fit;
        dgfemi_query_run(query, embedding->point_element[p], windows[p]);
        dgfemi_query_normalize(query);
        dgfemi_query_sort(query);
        dgfemi_query_fit(query, embedding->points[p], &fit);
        if (dgfemi_fit_is_flat(&fit)) {
            dgfemi_query_take_element(query, embedding->point_element[p]);
            dgfemi_query_fit(query, embedding->points[p], &fit);
        }
        dgfemi_query_weights(query, &fit, embedding->points[p]);
        if (!dgfemi_embedding_append(embedding, query, p, &sample_capacity, &weight_capacity)) return 0;
    }
    return 1;
}

/* Reads the points. DGFEM_ERROR_NOT_FINITE names the first bad one. */
static dgfem_status dgfemi_embedding_read_points(dgfem_embedding *embedding, const dgfem_points_in *points) {
    embedding->point_count = points->count;
    embedding->points = (dgfem_vec3 *)dgfemi_allocate(&embedding->hooks, (size_t)points->count, sizeof(dgfem_vec3));
    embedding->point_element = (int *)dgfemi_allocate(&embedding->hooks, (size_t)points->count, sizeof(int));
    embedding->weight_start = (int *)dgfemi_allocate_zero(&embedding->hooks, (size_t)points->count + 1, sizeof(int));
    if (!embedding->points || !embedding->point_element || !embedding->weight_start)
        return dgfemi_fail_memory(&embedding->hooks);
    for (int p = 0; p < points->count; p++) {
        embedding->points[p] = dgfemi_point_read(points, p);
        if (!dgfemi_is_finite3(embedding->points[p]))
            return dgfemi_fail(&embedding->hooks, DGFEM_ERROR_NOT_FINITE, "embedded point %d is (%g, %g, %g)", p,
                               (double)embedding->points[p].x, (double)embedding->points[p].y,
                               (double)embedding->points[p].z);
    }
    return DGFEM_OK;
}

/* Samples, locations and weights, with temporary memory from the arena. 1 on success, 0 when out of memory. */
static int dgfemi_embedding_build(dgfemi_arena *arena, const dgfem_body *body, const dgfem_corners *corners,
                                  dgfem_embedding *embedding) {
    dgfemi_locator locator;
    dgfemi_sampling sampling;
    dgfemi_query query;
    dgfem_vec3 *windows;
    char *open, *enlarge;
    if (!dgfemi_embedding_choose_samples(arena, embedding, body, corners) ||
        !dgfemi_locator_make(arena, body->mesh, &locator) ||
        !dgfemi_sampling_make(arena, body->mesh, embedding, &locator, &sampling) ||
        !dgfemi_query_make(arena, &sampling, &query))
        return 0;
    windows = (dgfem_vec3 *)dgfemi_arena_allocate(arena, (size_t)embedding->point_count, sizeof(dgfem_vec3));
    open = (char *)dgfemi_arena_allocate(arena, (size_t)embedding->point_count, 1);
    enlarge = (char *)dgfemi_arena_allocate(arena, (size_t)embedding->sample_count, 1);
    if (!windows || !open || !enlarge) return 0;
    for (int p = 0; p < embedding->point_count; p++) {
        dgfemi_location location = dgfemi_locate(&locator, embedding->points[p]);
        embedding->point_element[p] = location.element;
        windows[p] = dgfemi_window_position(body->mesh, &location, embedding->points[p]);
    }
    dgfemi_enlarge_windows(&query, embedding, windows, open, enlarge);
    return dgfemi_embedding_weigh(&query, embedding, windows);
}

DGFEM_API void dgfem_embedding_destroy(dgfem_embedding *embedding) {
    dgfem_hooks hooks;
    if (!embedding) return;
    hooks = embedding->hooks;
    dgfemi_free(&hooks, embedding->samples);
    dgfemi_free(&hooks, embedding->term_start);
    dgfemi_free(&hooks, embedding->term_element);
    dgfemi_free(&hooks, embedding->term_basis_start);
    dgfemi_free(&hooks, embedding->term_basis);
    dgfemi_free(&hooks, embedding->points);
    dgfemi_free(&hooks, embedding->point_element);
    dgfemi_free(&hooks, embedding->weight_start);
    dgfemi_free(&hooks, embedding->weight_sample);
    dgfemi_free(&hooks, embedding->weight);
    dgfemi_free(&hooks, embedding);
}

static dgfem_embedding *dgfemi_embedding_new(const dgfem_body *body, const dgfem_hooks *hooks) {
    dgfem_embedding *embedding = (dgfem_embedding *)dgfemi_allocate_zero(hooks, 1, sizeof *embedding);
    if (!embedding) return NULL;
    embedding->hooks = *hooks;
    embedding->revision = body->revision;
    return embedding;
}

static dgfem_status dgfemi_embedding_create(const dgfem_body *body, const dgfem_points_in *points,
                                            const dgfem_hooks *hooks, dgfem_embedding **out) {
    dgfem_embedding *embedding = dgfemi_embedding_new(body, hooks);
    dgfem_corners *corners = NULL;
    dgfemi_arena arena = dgfemi_arena_make(hooks);
    dgfem_status status;
    if (!embedding) return dgfemi_fail_memory(hooks);
    status = dgfemi_embedding_read_points(embedding, points);
    if (status == DGFEM_OK) status = dgfem_mesh_corners(body->mesh, &corners);
    if (status == DGFEM_OK && !dgfemi_embedding_build(&arena, body, corners, embedding))
        status = dgfemi_fail_memory(hooks);
    dgfemi_arena_free(&arena);
    dgfem_corners_destroy(corners);
    if (status != DGFEM_OK) {
        dgfem_embedding_destroy(embedding);
        return status;
    }
    *out = embedding;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_embedding_create(const dgfem_body *body, dgfem_points_in points, dgfem_embedding **out) {
    dgfem_status status;
    if (out) *out = NULL;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!out) return dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "embedding: no place for the result");
    status = dgfemi_check_points(&body->hooks, points.data, points.type, points.stride, points.count, "embedding");
    if (status != DGFEM_OK) return status;
    return dgfemi_embedding_create(body, &points, &body->hooks, out);
}

/* ---- evaluation ---- */

#define DGFEM_EMBEDDING_GRAIN 256

typedef struct dgfemi_embedding_range {
    const dgfem_embedding *embedding;
    const dgfem_body *body;
    const dgfem_vec3 *in;
    dgfem_vec3 *out;
} dgfemi_embedding_range;

static dgfem_vec3 dgfemi_embedding_sample(const dgfem_embedding *embedding, const dgfem_body *body,
                                          const dgfem_vec3 *coefficients, int sample) {
    int first = embedding->term_start[sample], last = embedding->term_start[sample + 1];
    dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
    for (int t = first; t < last; t++) {
        const dgfem_vec3 *u = coefficients + body->basis_start[embedding->term_element[t]];
        const dgfem_real *basis = embedding->term_basis + embedding->term_basis_start[t];
        int count = embedding->term_basis_start[t + 1] - embedding->term_basis_start[t];
        for (int i = 0; i < count; i++) sum = dgfemi_add_scaled(sum, basis[i], u[i]);
    }
    return dgfemi_scale(1 / (dgfem_real)(last - first), sum);
}

static void dgfemi_embedding_samples_range(void *context, int first, int last) {
    const dgfemi_embedding_range *range = (const dgfemi_embedding_range *)context;
    for (int s = first; s < last; s++)
        range->out[s] = dgfemi_embedding_sample(range->embedding, range->body, range->in, s);
}

static void dgfemi_embedding_points_range(void *context, int first, int last) {
    const dgfemi_embedding_range *range = (const dgfemi_embedding_range *)context;
    const dgfem_embedding *embedding = range->embedding;
    for (int p = first; p < last; p++) {
        dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
        for (int i = embedding->weight_start[p]; i < embedding->weight_start[p + 1]; i++)
            sum = dgfemi_add_scaled(sum, embedding->weight[i], range->in[embedding->weight_sample[i]]);
        range->out[p] = sum;
    }
}

/* out[sample_count]: the samples' means of the polynomials with these coefficients (displacement, velocity). */
static void dgfemi_embedding_samples(const dgfem_embedding *embedding, const dgfem_body *body,
                                     const dgfem_vec3 *coefficients, dgfem_vec3 *out) {
    dgfemi_embedding_range range;
    DGFEM_ASSERT(embedding->revision == body->revision);
    range.embedding = embedding, range.body = body, range.in = coefficients, range.out = out;
    dgfemi_parallel_for(&embedding->hooks, embedding->sample_count, DGFEM_EMBEDDING_GRAIN,
                        dgfemi_embedding_samples_range, &range);
}

/* out[point_count]: weighted sums of the samples' values. */
static void dgfemi_embedding_points(const dgfem_embedding *embedding, const dgfem_vec3 *sample_values,
                                    dgfem_vec3 *out) {
    dgfemi_embedding_range range;
    range.embedding = embedding, range.body = NULL, range.in = sample_values, range.out = out;
    dgfemi_parallel_for(&embedding->hooks, embedding->point_count, DGFEM_EMBEDDING_GRAIN, dgfemi_embedding_points_range,
                        &range);
}

/* ==== contact.c =================================================================================================== */

/* Penalty contact and friction of embedded points against planes and spheres, implicit in the step's velocities.

   A point has the displacement W u and the velocity W v, where the row W holds a coefficient for each basis function of
   the elements it depends on. With its shape's normal n, depth d, velocity v_s and the step h, the force at the end of
   the step is
     f = n (k (d - h n.(w - v_s)) - c n.(w - v_s)) - c_t (I - n n^T)(w - v_s),     w = W v+,
     k = area * stiffness * E / radius of the touched elements, c = damping * k,
     c_t = friction * f_n / max(|v_t|, slip speed),
   that is, the step's system A v+ = b gains A += W^T B W and b += W^T g with
     B = (h^2 k + h c) n n^T + h c_t (I - n n^T),    g = h k d n + B v_s.

   W^T B W couples elements that are not face neighbours, and the graph of A must not change with every contact. With
   a_e the part of W in element e and shares s_e > 0 that sum to one, Cauchy-Schwarz bounds it by diagonal blocks,
     W^T B W  <=  P = blockdiag(a_e^T B a_e / s_e),
   and they agree for a rigid translation where s_e is e's part of the weight and no weight is negative. P takes the
   place of W^T B W in A, and b gains (P - W^T B W) v. Then (P - W^T B W)(v+ - v) is all the difference: it acts on
   changes of velocity only, like mass. Steady states (rest, sliding) are those of the exact contact, and the step stays
   as stable as an implicit one, for P is no smaller than the true Jacobian. (Without that part of b a body is damped
   instead: one that stands on an edge falls over as if in honey.) */

struct dgfem_contacts {
    dgfem_embedding *embedding; /* of the contact points */
    int from_corners;           /* 1: the points are the mesh's boundary corners */
    dgfem_real *area;           /* [points] */
    dgfem_vec3 *sample_value;   /* [samples] */
    dgfem_vec3 *displacement;   /* [points] */
    dgfem_vec3 *velocity;       /* [points] */
    dgfem_real *row;            /* [basis_count] W of one point; zero outside its elements */
    int *element;               /* [elements] elements of the row */
    int element_count;
    dgfem_real *share; /* [elements] s_e of element[i] */
    char *mark;        /* [elements] 1 for the elements of the row */
    dgfem_hooks hooks;
};

/* ---- contact points ---- */

static int dgfemi_face_is_open(const dgfem_face *face) { return face->element[1] == DGFEM_NONE || face->cut; }

/* Shares out the area of a face among its corners, each in proportion to its two edges. */
static void dgfemi_face_share_area(const dgfem_mesh *mesh, const dgfem_face *face, const int *corner_of_vertex,
                                   dgfem_real *area) {
    dgfem_real perimeter = 0;
    for (int pass = 0; pass < 2; pass++)
        for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
            const int *loop = mesh->loop_vertices + mesh->loops[l].start;
            int count = mesh->loops[l].count;
            for (int i = 0; i < count; i++) {
                int a = loop[i], b = loop[i + 1 < count ? i + 1 : 0];
                dgfem_real length = dgfemi_distance(mesh->vertices[a], mesh->vertices[b]), half;
                if (pass == 0) perimeter += length;
                if (pass == 0 || !(perimeter > 0)) continue;
                half = DGFEM_R(0.5) * face->area * (length / perimeter);
                area[corner_of_vertex[a]] += half;
                area[corner_of_vertex[b]] += half;
            }
        }
}

/* area[corners]: what each corner has of the boundary and of both sides of cut faces; 0 inside. */
static void dgfemi_corner_areas(const dgfem_mesh *mesh, const dgfem_corners *corners, int *corner_of_vertex,
                                dgfem_real *area) {
    for (int e = 0; e < mesh->element_count; e++) {
        const dgfem_element *element = &mesh->elements[e];
        for (int i = corners->corner_start[e]; i < corners->corner_start[e + 1]; i++)
            corner_of_vertex[corners->vertex[corners->corners[i]]] = corners->corners[i];
        for (int k = element->face_start; k < element->face_start + element->face_count; k++) {
            const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
            if (dgfemi_face_is_open(face)) dgfemi_face_share_area(mesh, face, corner_of_vertex, area);
        }
    }
}

/* Points that are samples themselves: one weight each, 1. */
static int dgfemi_embedding_set_points_to_samples(dgfem_embedding *embedding) {
    const dgfem_hooks *hooks = &embedding->hooks;
    size_t count = (size_t)embedding->sample_count;
    embedding->point_count = embedding->sample_count;
    embedding->points = (dgfem_vec3 *)dgfemi_duplicate(hooks, embedding->samples, count, sizeof(dgfem_vec3));
    embedding->point_element = (int *)dgfemi_allocate(hooks, count, sizeof(int));
    embedding->weight_start = (int *)dgfemi_allocate(hooks, count + 1, sizeof(int));
    embedding->weight_sample = (int *)dgfemi_allocate(hooks, count, sizeof(int));
    embedding->weight = (dgfem_real *)dgfemi_allocate(hooks, count, sizeof(dgfem_real));
    if (!embedding->points || !embedding->point_element || !embedding->weight_start || !embedding->weight_sample ||
        !embedding->weight)
        return 0;
    for (int s = 0; s < embedding->sample_count; s++) {
        embedding->point_element[s] = embedding->term_element[embedding->term_start[s]];
        embedding->weight_start[s] = embedding->weight_sample[s] = s;
        embedding->weight[s] = 1;
    }
    embedding->weight_start[embedding->sample_count] = embedding->sample_count;
    return 1;
}

/* The corners that have a part of the boundary, as an embedding with one sample per point. 1 on success. */
static int dgfemi_contacts_take_corners(dgfemi_arena *arena, dgfem_contacts *contacts, const dgfem_body *body,
                                        const dgfem_corners *corners) {
    size_t count = (size_t)corners->count, terms = (size_t)corners->element_start[corners->count];
    int *corner_of_vertex = (int *)dgfemi_arena_allocate(arena, (size_t)body->mesh->vertex_count, sizeof(int));
    int *start = (int *)dgfemi_arena_allocate(arena, count + 1, sizeof(int));
    int *elements = (int *)dgfemi_arena_allocate(arena, terms, sizeof(int));
    dgfem_vec3 *positions = (dgfem_vec3 *)dgfemi_arena_allocate(arena, count, sizeof(dgfem_vec3));
    int points = 0, term = 0;
    contacts->area = (dgfem_real *)dgfemi_allocate_zero(&contacts->hooks, count, sizeof(dgfem_real));
    if (!corner_of_vertex || !start || !elements || !positions || !contacts->area) return 0;
    dgfemi_corner_areas(body->mesh, corners, corner_of_vertex, contacts->area);
    for (int c = 0; c < corners->count; c++) {
        if (!(contacts->area[c] > 0)) continue;
        contacts->area[points] = contacts->area[c];
        positions[points] = body->mesh->vertices[corners->vertex[c]];
        start[points++] = term;
        for (int i = corners->element_start[c]; i < corners->element_start[c + 1]; i++)
            elements[term++] = corners->elements[i];
    }
    start[points] = term;
    return dgfemi_embedding_set_samples(contacts->embedding, body, positions, start, elements, points) &&
           dgfemi_embedding_set_points_to_samples(contacts->embedding);
}

static dgfem_status dgfemi_contacts_embed_corners(dgfem_contacts *contacts, const dgfem_body *body) {
    dgfem_corners *corners;
    dgfemi_arena arena = dgfemi_arena_make(&contacts->hooks);
    dgfem_status status = dgfem_mesh_corners(body->mesh, &corners);
    if (status != DGFEM_OK) return status;
    contacts->embedding = dgfemi_embedding_new(body, &contacts->hooks);
    if (!contacts->embedding || !dgfemi_contacts_take_corners(&arena, contacts, body, corners))
        status = dgfemi_fail_memory(&contacts->hooks);
    dgfemi_arena_free(&arena);
    dgfem_corners_destroy(corners);
    return status;
}

/* All that assembly needs, so that it allocates nothing. 1 on success. */
static int dgfemi_contacts_reserve(dgfem_contacts *contacts, const dgfem_body *body) {
    const dgfem_hooks *hooks = &contacts->hooks;
    size_t points = (size_t)contacts->embedding->point_count, samples = (size_t)contacts->embedding->sample_count;
    size_t elements = (size_t)body->mesh->element_count;
    contacts->sample_value = (dgfem_vec3 *)dgfemi_allocate(hooks, samples, sizeof(dgfem_vec3));
    contacts->displacement = (dgfem_vec3 *)dgfemi_allocate(hooks, points, sizeof(dgfem_vec3));
    contacts->velocity = (dgfem_vec3 *)dgfemi_allocate(hooks, points, sizeof(dgfem_vec3));
    contacts->row = (dgfem_real *)dgfemi_allocate_zero(hooks, (size_t)body->basis_count, sizeof(dgfem_real));
    contacts->element = (int *)dgfemi_allocate(hooks, elements, sizeof(int));
    contacts->share = (dgfem_real *)dgfemi_allocate(hooks, elements, sizeof(dgfem_real));
    contacts->mark = (char *)dgfemi_allocate_zero(hooks, elements, 1);
    return contacts->sample_value && contacts->displacement && contacts->velocity && contacts->row &&
           contacts->element && contacts->share && contacts->mark;
}

static void dgfemi_contacts_destroy(dgfem_contacts *contacts) {
    dgfem_hooks hooks;
    if (!contacts) return;
    hooks = contacts->hooks;
    dgfem_embedding_destroy(contacts->embedding);
    dgfemi_free(&hooks, contacts->area);
    dgfemi_free(&hooks, contacts->sample_value);
    dgfemi_free(&hooks, contacts->displacement);
    dgfemi_free(&hooks, contacts->velocity);
    dgfemi_free(&hooks, contacts->row);
    dgfemi_free(&hooks, contacts->element);
    dgfemi_free(&hooks, contacts->share);
    dgfemi_free(&hooks, contacts->mark);
    dgfemi_free(&hooks, contacts);
}

/* Contact points of a body: the given rest positions, each with its area; or, where `points` is NULL, the boundary
   corners of the mesh with their parts of the boundary. */
static dgfem_status dgfemi_contacts_create(const dgfem_body *body, const dgfem_points_in *points,
                                           const dgfem_real *areas, dgfem_contacts **out) {
    const dgfem_hooks *hooks = &body->hooks;
    dgfem_contacts *contacts = (dgfem_contacts *)dgfemi_allocate_zero(hooks, 1, sizeof *contacts);
    dgfem_status status;
    DGFEM_ASSERT(!points || areas);
    if (!contacts) return dgfemi_fail_memory(hooks);
    contacts->hooks = *hooks;
    contacts->from_corners = !points;
    if (points) {
        status = dgfemi_embedding_create(body, points, hooks, &contacts->embedding);
        if (status == DGFEM_OK) {
            contacts->area = (dgfem_real *)dgfemi_duplicate(hooks, areas, (size_t)points->count, sizeof(dgfem_real));
            if (!contacts->area) status = dgfemi_fail_memory(hooks);
        }
    } else {
        status = dgfemi_contacts_embed_corners(contacts, body);
    }
    if (status == DGFEM_OK && !dgfemi_contacts_reserve(contacts, body)) status = dgfemi_fail_memory(hooks);
    if (status != DGFEM_OK) {
        dgfemi_contacts_destroy(contacts);
        return status;
    }
    *out = contacts;
    return DGFEM_OK;
}

/* The same contact points for a body whose polynomials or elements have changed. */
static dgfem_status dgfemi_contacts_renew(const dgfem_contacts *old, const dgfem_body *body, dgfem_contacts **out) {
    if (old->from_corners) return dgfemi_contacts_create(body, NULL, NULL, out);
    dgfem_points_in points = dgfem_points_in_vec3(old->embedding->points, old->embedding->point_count);
    return dgfemi_contacts_create(body, &points, old->area, out);
}

/* ---- one contact ---- */

/* Signed distance of x from the shape, positive where the body may be, and the direction in which it grows. */
static dgfem_real dgfemi_shape_distance(const dgfem_shape *shape, dgfem_vec3 x, dgfem_vec3 *normal) {
    const dgfem_shape_desc *desc = &shape->desc;
    if (shape->kind == DGFEM_SHAPE_PLANE) {
        dgfem_real length = dgfemi_norm(desc->plane.normal);
        *normal = dgfemi_scale(1 / length, desc->plane.normal);
        return dgfemi_dot(*normal, x) - desc->plane.offset / length;
    }
    dgfem_vec3 d = dgfemi_sub(x, desc->centre);
    dgfem_real length = dgfemi_norm(d);
    *normal = length > 0 ? dgfemi_scale(1 / length, d) : dgfemi_vec3(0, 0, 1); /* at the centre any direction will do */
    if (desc->radius > 0) return length - desc->radius;
    *normal = dgfemi_scale(-1, *normal);
    return -desc->radius - length;
}

typedef struct dgfemi_contact {
    dgfem_vec3 normal;
    dgfem_real depth; /* at the beginning of the step */
} dgfemi_contact;

/* Whether the point presses against the shape at the end of the step, moving on as it does: one that leaves is not held
   back, one that arrives (depth < 0) is stopped at the surface. Below the surface gravity counts with what it will add,
   and damping acts: without gravity a body at rest would hop by g h^2 forever. Above it must not count: a foot that
   something else wants to lift would be glued to the ground. */
static int dgfemi_contact_is_active(const dgfem_shape *shape, dgfem_vec3 x, dgfem_vec3 v, dgfem_vec3 gravity,
                                    dgfem_real dt, dgfemi_contact *contact) {
    dgfem_vec3 relative = dgfemi_sub(v, shape->desc.velocity);
    dgfem_real delay = dt;
    contact->depth = -dgfemi_shape_distance(shape, x, &contact->normal);
    if (contact->depth > 0) {
        relative = dgfemi_add_scaled(relative, dt, gravity);
        delay += shape->desc.damping;
    }
    return contact->depth - delay * dgfemi_dot(contact->normal, relative) > 0;
}

/* Adds B and g of an active contact with stiffness k. Friction follows the normal force that the last step has left,
   k d and its damping: a point that has just arrived feels it one step later, when what stopped it is known. */
static void dgfemi_contact_linearize(const dgfem_shape *shape, const dgfemi_contact *contact, dgfem_vec3 v,
                                     dgfem_real k, dgfem_real dt, dgfem_mat3 *b, dgfem_vec3 *g) {
    const dgfem_shape_desc *desc = &shape->desc;
    dgfem_vec3 n = contact->normal, relative = dgfemi_sub(v, desc->velocity);
    dgfem_real speed = dgfemi_dot(n, relative), normal = dt * dt * k, tangential = 0;
    if (contact->depth > 0) {
        dgfem_real force = k * (contact->depth - desc->damping * speed);
        dgfem_real slip = dgfemi_max(dgfemi_norm(dgfemi_add_scaled(relative, -speed, n)), desc->slip_speed);
        normal += dt * desc->damping * k;
        if (force > 0 && slip > 0) tangential = dt * desc->friction * force / slip;
    }
    for (int i = 0; i < 3; i++) b->m[i][i] += tangential;
    dgfemi_add_outer(b, normal - tangential, n, n);
    speed = dgfemi_dot(n, desc->velocity);
    *g = dgfemi_add_scaled(*g, tangential, desc->velocity);
    *g = dgfemi_add_scaled(*g, dt * k * contact->depth + (normal - tangential) * speed, n);
}

/* ---- rows W ---- */

/* s_e in proportion to the largest coefficient: that of the constant, e's part of the weight, unless weights of both
   signs cancel there. An element whose coefficients all vanish gets 0. */
static void dgfemi_contacts_share_out(dgfem_contacts *contacts, const dgfem_body *body) {
    dgfem_real total = 0;
    for (int i = 0; i < contacts->element_count; i++) {
        int e = contacts->element[i];
        contacts->share[i] = 0;
        for (int j = body->basis_start[e]; j < body->basis_start[e + 1]; j++)
            contacts->share[i] = dgfemi_max(contacts->share[i], dgfemi_abs(contacts->row[j]));
        total += contacts->share[i];
    }
    for (int i = 0; i < contacts->element_count; i++) contacts->share[i] /= total;
}

/* Composes the row of a point from its weights and the terms of their samples. */
static void dgfemi_contacts_compose(dgfem_contacts *contacts, const dgfem_body *body, int point) {
    const dgfem_embedding *embedding = contacts->embedding;
    DGFEM_ASSERT(contacts->element_count == 0);
    for (int i = embedding->weight_start[point]; i < embedding->weight_start[point + 1]; i++) {
        int first = embedding->term_start[embedding->weight_sample[i]];
        int last = embedding->term_start[embedding->weight_sample[i] + 1];
        dgfem_real weight = embedding->weight[i] / (dgfem_real)(last - first);
        for (int t = first; t < last; t++) {
            int e = embedding->term_element[t], start = embedding->term_basis_start[t];
            dgfem_real *row = contacts->row + body->basis_start[e];
            if (!contacts->mark[e]) contacts->mark[e] = 1, contacts->element[contacts->element_count++] = e;
            for (int j = start; j < embedding->term_basis_start[t + 1]; j++)
                row[j - start] += weight * embedding->term_basis[j];
        }
    }
    dgfemi_contacts_share_out(contacts, body);
}

static void dgfemi_contacts_clear_row(dgfem_contacts *contacts, const dgfem_body *body) {
    for (int i = 0; i < contacts->element_count; i++) {
        int e = contacts->element[i];
        contacts->mark[e] = 0;
        for (int j = body->basis_start[e]; j < body->basis_start[e + 1]; j++) contacts->row[j] = 0;
    }
    contacts->element_count = 0;
}

/* E / radius of what the point touches: of its elements, by their shares. */
static dgfem_real dgfemi_contacts_modulus(const dgfem_contacts *contacts, const dgfem_body *body) {
    dgfem_real young = 0, radius = 0;
    for (int i = 0; i < contacts->element_count; i++) {
        young += contacts->share[i] * body->material[contacts->element[i]].young;
        radius += contacts->share[i] * body->mesh->elements[contacts->element[i]].radius;
    }
    return young / radius;
}

/* block += s (a a^T) (x) B,  n basis functions, row-major 3n x 3n. */
static void dgfemi_add_kronecker(dgfem_real *block, const dgfem_real *a, int n, dgfem_real s, const dgfem_mat3 *b) {
    for (int i = 0; i < n; i++)
        for (int p = 0; p < 3; p++) {
            dgfem_real *line = block + (3 * i + p) * 3 * n, factor = s * a[i];
            for (int j = 0; j < n; j++)
                for (int q = 0; q < 3; q++) line[3 * j + q] += factor * a[j] * b->m[p][q];
        }
}

/* matrix += P, rhs += W^T g for the composed row. */
static void dgfemi_contacts_add_row(const dgfem_contacts *contacts, const dgfem_body *body, const dgfem_mat3 *b,
                                    dgfem_vec3 g, dgfem_matrix *matrix, dgfem_vec3 *rhs) {
    for (int i = 0; i < contacts->element_count; i++) {
        int e = contacts->element[i], start = body->basis_start[e], n = body->basis_start[e + 1] - start;
        const dgfem_real *a = contacts->row + start;
        if (!(contacts->share[i] > 0)) continue;
        for (int j = 0; j < n; j++) rhs[start + j] = dgfemi_add_scaled(rhs[start + j], a[j], g);
        dgfemi_add_kronecker(dgfem_matrix_block(matrix, e, e), a, n, 1 / contacts->share[i], b);
    }
}

static dgfem_vec3 dgfemi_row_product(const dgfem_real *a, const dgfem_vec3 *x, int n) {
    dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
    for (int j = 0; j < n; j++) sum = dgfemi_add_scaled(sum, a[j], x[j]);
    return sum;
}

/* y += (P - W^T B W) x for the composed row. */
static void dgfemi_contacts_add_row_rest(const dgfem_contacts *contacts, const dgfem_body *body, const dgfem_mat3 *b,
                                         const dgfem_vec3 *x, dgfem_vec3 *y) {
    dgfem_vec3 all = dgfemi_vec3(0, 0, 0);
    for (int i = 0; i < contacts->element_count; i++) {
        int start = body->basis_start[contacts->element[i]], n = body->basis_start[contacts->element[i] + 1] - start;
        all = dgfemi_add(all, dgfemi_row_product(contacts->row + start, x + start, n));
    }
    for (int i = 0; i < contacts->element_count; i++) {
        int start = body->basis_start[contacts->element[i]], n = body->basis_start[contacts->element[i] + 1] - start;
        const dgfem_real *a = contacts->row + start;
        dgfem_vec3 part;
        if (!(contacts->share[i] > 0)) continue;
        part = dgfemi_scale(1 / contacts->share[i], dgfemi_row_product(a, x + start, n));
        part = dgfemi_multiply(b, dgfemi_sub(part, all));
        for (int j = 0; j < n; j++) y[start + j] = dgfemi_add_scaled(y[start + j], a[j], part);
    }
}

/* ---- assembly ---- */

/* Adds all contacts of one point. 1 when it has any. */
static int dgfemi_contacts_add_point(dgfem_contacts *contacts, const dgfem_body *body, int point, dgfem_real dt,
                                     dgfem_matrix *matrix, dgfem_vec3 *rhs) {
    dgfem_vec3 x = dgfemi_add(contacts->embedding->points[point], contacts->displacement[point]);
    dgfem_vec3 v = contacts->velocity[point], g = dgfemi_vec3(0, 0, 0);
    dgfem_real modulus = 0;
    dgfem_mat3 b;
    memset(&b, 0, sizeof b);
    for (int s = 0; s < body->shape_count; s++) {
        const dgfem_shape *shape = &body->shapes[s];
        dgfemi_contact contact;
        if (!dgfemi_contact_is_active(shape, x, v, body->desc.gravity, dt, &contact)) continue;
        if (contacts->element_count == 0) {
            dgfemi_contacts_compose(contacts, body, point);
            modulus = dgfemi_contacts_modulus(contacts, body);
        }
        dgfem_real stiffness = contacts->area[point] * shape->desc.stiffness * modulus;
        dgfemi_contact_linearize(shape, &contact, v, stiffness, dt, &b, &g);
    }
    if (contacts->element_count == 0) return 0;
    dgfemi_contacts_add_row(contacts, body, &b, g, matrix, rhs);
    dgfemi_contacts_add_row_rest(contacts, body, &b, body->velocity, rhs);
    dgfemi_contacts_clear_row(contacts, body);
    return 1;
}

/* Adds contact to the step's system A v+ = b; A has the scale of M + h^2 K, b that of M v + h F. Returns the number of
   points in contact. Allocates nothing. */
static int dgfemi_contacts_assemble(dgfem_contacts *contacts, const dgfem_body *body, dgfem_real dt,
                                    dgfem_matrix *matrix, dgfem_vec3 *b) {
    const dgfem_embedding *embedding = contacts->embedding;
    int active = 0;
    dgfemi_embedding_samples(embedding, body, body->displacement, contacts->sample_value);
    dgfemi_embedding_points(embedding, contacts->sample_value, contacts->displacement);
    dgfemi_embedding_samples(embedding, body, body->velocity, contacts->sample_value);
    dgfemi_embedding_points(embedding, contacts->sample_value, contacts->velocity);
    for (int p = 0; p < embedding->point_count; p++)
        active += dgfemi_contacts_add_point(contacts, body, p, dt, matrix, b);
    return active;
}

/* ==== warp.c ====================================================================================================== */

/* Stiffness warping: rotations of the elements, and the warped system assembled from the forms.

   A rotated block follows from rotated vectors, so nothing is stored or multiplied as a 3x3 matrix that need not be.
   With R the element's rotation, n' = R n, q' = R q, and  S' = R S R^T:

     element  K'_ij = lambda G'_ij + mu G'_ij^T + mu tr(G'_ij) I
     face     K1'_ij = -w (lambda n' q'^T + mu q' n'^T + mu (n'.q') I),  q' = R_s q^s_ij     (columns j of side s)
              K'_ij = K1'_ij + K1'_ji^T + P_ij S_stiff + Q_ij S_rest
              S_stiff = eta_stiff (mu I + (lambda + mu) N),  S_rest = eta_rest mu (I + N),
              N = (n_a' n_a'^T + n_b' n_b'^T) / 2, each with its own element's rotation

   The undeformed position is the polynomial X0 with linear coefficients scale * e_k. Stresses come from the
   displacement in the rotated frame, R^T (X0 + U) - X0, so that K' U - f0 is the internal force with
     f0_i = sum_j K'_ij (R - I) X0_j       over K'_ij of elements and K1'_ij of faces only. */

/* ---- rotations ---- */

/* Mean deformation gradient of an element: I + (1/V) int grad u. For degrees 1 and 2 the mean of quadratic terms'
   gradients vanishes at the centroid; cubic ones need the element's moments, which the mass row of linear functions
   holds: int (d_a N_j) is a moment of degree 2. */
static dgfem_mat3 dgfemi_mean_gradient(const dgfem_body *body, int element) {
    const dgfemi_element_form *form = &body->forms->elements[element];
    const dgfem_vec3 *u = body->displacement + body->basis_start[element];
    const dgfem_real *moments = dgfemi_form_load(body->forms, element);
    dgfem_real inverse = 1 / (body->scale[element] * moments[0]);
    dgfem_mat3 f = dgfemi_identity();
    for (int j = 1; j < form->count; j++)
        for (int a = 0; a < 3; a++) {
            int lower = dgfemi_derivative_index(j, a);
            if (lower == DGFEM_NONE) continue;
            dgfem_real d = (dgfem_real)dgfemi_exponents[j][a] * moments[lower] * inverse;
            f.m[0][a] += d * u[j].x;
            f.m[1][a] += d * u[j].y;
            f.m[2][a] += d * u[j].z;
        }
    return f;
}

typedef struct dgfemi_rotation_range {
    const dgfem_body *body;
    dgfem_mat3 *rotation;
} dgfemi_rotation_range;

static void dgfemi_rotations_in_range(void *context, int first, int last) {
    const dgfemi_rotation_range *range = (const dgfemi_rotation_range *)context;
    for (int e = first; e < last; e++)
        range->rotation[e] = dgfem_rotation_of(dgfemi_mean_gradient(range->body, e), range->body->rotation[e]);
}

/* Rotations of all elements for the current displacement; without warping all are the identity. */
static void dgfemi_rotations(const dgfem_body *body, dgfem_mat3 *rotation) {
    dgfemi_rotation_range range;
    range.body = body;
    range.rotation = rotation;
    if (body->desc.warp) {
        dgfemi_parallel_for(&body->hooks, body->mesh->element_count, 64, dgfemi_rotations_in_range, &range);
        return;
    }
    for (int e = 0; e < body->mesh->element_count; e++) rotation[e] = dgfemi_identity();
}

/* (R - I) X0_j for j = 1, 2, 3 */
static void dgfemi_rotated_rest(const dgfem_mat3 *r, dgfem_real scale, dgfem_vec3 out[3]) {
    for (int j = 0; j < 3; j++) {
        out[j] = dgfemi_scale(scale, dgfemi_column(r, j));
        if (j == 0) out[j].x -= scale;
        if (j == 1) out[j].y -= scale;
        if (j == 2) out[j].z -= scale;
    }
}

/* ---- blocks ---- */

/* lambda u v^T + mu v u^T + mu (u.v) I */
static dgfem_mat3 dgfemi_elastic_block(dgfem_real lambda, dgfem_real mu, dgfem_vec3 u, dgfem_vec3 v) {
    dgfem_mat3 a;
    dgfem_real d = mu * dgfemi_dot(u, v);
    a.m[0][0] = (lambda + mu) * u.x * v.x + d;
    a.m[1][1] = (lambda + mu) * u.y * v.y + d;
    a.m[2][2] = (lambda + mu) * u.z * v.z + d;
    a.m[0][1] = lambda * u.x * v.y + mu * v.x * u.y;
    a.m[1][0] = lambda * u.y * v.x + mu * v.y * u.x;
    a.m[0][2] = lambda * u.x * v.z + mu * v.x * u.z;
    a.m[2][0] = lambda * u.z * v.x + mu * v.z * u.x;
    a.m[1][2] = lambda * u.y * v.z + mu * v.y * u.z;
    a.m[2][1] = lambda * u.z * v.y + mu * v.z * u.y;
    return a;
}

/* K'_ij of an element, i, j >= 1. */
static dgfem_mat3 dgfemi_element_block(const dgfem_real *g, dgfem_real lambda, dgfem_real mu, const dgfem_mat3 *r,
                                       const dgfem_mat3 *rt) {
    dgfem_mat3 moment, rotated, k;
    memcpy(&moment, g, sizeof moment);
    rotated = dgfemi_multiply3(r, &moment);
    rotated = dgfemi_multiply3(&rotated, rt);
    dgfem_real diagonal = mu * dgfemi_trace(&moment);
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            k.m[a][b] = lambda * rotated.m[a][b] + mu * rotated.m[b][a] + (a == b ? diagonal : 0);
    return k;
}

/* A face's form with today's rotations. */
typedef struct dgfemi_warped_face {
    const dgfemi_face_form *form;
    int sides;                     /* functions of both sides */
    const dgfem_real *stiff, *rest;
    dgfem_mat3 penalty_stiff, penalty_rest;
    dgfem_vec3 normal[2];          /* rotated with each side */
    dgfem_vec3 held;               /* the direction held where it is only one: the normal at rest, fixed in space */
    dgfem_real lambda[2], mu[2];   /* times -weight */
    dgfem_vec3 traction[2][2 * DGFEM_MAX_BASIS][DGFEM_MAX_BASIS - 1]; /* q' of each side */
} dgfemi_warped_face;

/* s (a I + b N) */
static dgfem_mat3 dgfemi_penalty_block(dgfem_real s, dgfem_real a, dgfem_real b, const dgfem_mat3 *n) {
    dgfem_mat3 p;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) p.m[i][j] = s * ((i == j ? a : 0) + b * n->m[i][j]);
    return p;
}

static void dgfemi_warp_face_penalty(const dgfem_body *body, dgfemi_warped_face *face) {
    const dgfemi_face_form *form = face->form;
    int b = form->element[1] == DGFEM_NONE ? form->element[0] : form->element[1];
    const dgfem_material *ma = &body->material[form->element[0]], *mb = &body->material[b];
    dgfem_real mu = dgfemi_max(dgfemi_mu(ma), dgfemi_mu(mb));
    dgfem_real lambda = dgfemi_max(dgfemi_lambda(ma), dgfemi_lambda(mb));
    dgfem_mat3 n;
    memset(&n, 0, sizeof n);
    dgfemi_add_outer(&n, DGFEM_R(0.5), face->normal[0], face->normal[0]);
    dgfemi_add_outer(&n, DGFEM_R(0.5), face->normal[1], face->normal[1]);
    if (body->desc.penalty == DGFEM_PENALTY_SCALAR)
        face->penalty_stiff = dgfemi_penalty_block(form->eta_stiff, lambda + 2 * mu, 0, &n);
    else
        face->penalty_stiff = dgfemi_penalty_block(form->eta_stiff, mu, lambda + mu, &n);
    face->penalty_rest = dgfemi_penalty_block(form->eta_rest * mu, 1, 1, &n);
    if (!form->normal_only) return;
    memset(&n, 0, sizeof n);
    dgfemi_add_outer(&n, 1, face->held, face->held);
    face->penalty_stiff = dgfemi_penalty_block(form->eta_stiff, 0, lambda + 2 * mu, &n);
    face->penalty_rest = dgfemi_penalty_block(form->eta_rest, 0, 2 * mu, &n);
}

static void dgfemi_warp_face(const dgfem_body *body, const dgfemi_face_form *form, const dgfem_mat3 *rotation,
                             dgfemi_warped_face *face) {
    const dgfem_forms *forms = body->forms;
    dgfem_vec3 n = body->mesh->faces[form->face].normal;
    face->form = form;
    face->held = n;
    face->sides = form->count[0] + form->count[1];
    face->stiff = dgfemi_form_stiff(forms, form);
    face->rest = dgfemi_form_rest(forms, form);
    for (int s = 0; s < 2; s++) {
        int element = form->element[s] == DGFEM_NONE ? form->element[0] : form->element[s];
        const dgfem_mat3 *r = &rotation[element];
        const dgfem_material *m = &body->material[element];
        face->normal[s] = dgfemi_multiply(r, n);
        face->lambda[s] = -form->weight * dgfemi_lambda(m);
        face->mu[s] = -form->weight * dgfemi_mu(m);
        if (!dgfemi_form_has_traction(form, s)) continue;
        const dgfem_vec3 *q = dgfemi_form_traction(forms, form, s);
        for (int i = 0; i < face->sides; i++)
            for (int j = 0; j < form->count[s] - 1; j++) face->traction[s][i][j] = dgfemi_multiply(r, *q++);
    }
    dgfemi_warp_face_penalty(body, face);
}

/* K1'_ij: i counts the functions of both sides, j >= 1 those of side s. */
static dgfem_mat3 dgfemi_consistency_block(const dgfemi_warped_face *face, int s, int i, int j) {
    dgfem_mat3 k = dgfemi_elastic_block(face->lambda[s], face->mu[s], face->normal[s], face->traction[s][i][j - 1]);
    if (!face->form->normal_only) return k;
    dgfem_mat3 held;
    memset(&held, 0, sizeof held);
    dgfemi_add_outer(&held, 1, face->held, dgfemi_multiply_transposed(&k, face->held));
    return held;
}

/* P_ij S_stiff + Q_ij S_rest: i and j count the functions of both sides. */
static dgfem_mat3 dgfemi_jump_block(const dgfemi_warped_face *face, int i, int j) {
    dgfem_real p = face->stiff[i * face->sides + j], q = face->rest[i * face->sides + j];
    dgfem_mat3 k;
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) k.m[a][b] = p * face->penalty_stiff.m[a][b] + q * face->penalty_rest.m[a][b];
    return k;
}

/* K'_ij of a face with i a function of side r and j one of side s (both counted within their side). */
static dgfem_mat3 dgfemi_face_block(const dgfemi_warped_face *face, int r, int i, int s, int j) {
    int row = r ? face->form->count[0] + i : i, column = s ? face->form->count[0] + j : j;
    dgfem_mat3 k = dgfemi_jump_block(face, row, column);
    if (j > 0 && dgfemi_form_has_traction(face->form, s)) {
        dgfem_mat3 k1 = dgfemi_consistency_block(face, s, row, j);
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++) k.m[a][b] += k1.m[a][b];
    }
    if (i > 0 && dgfemi_form_has_traction(face->form, r)) {
        dgfem_mat3 k1 = dgfemi_consistency_block(face, r, column, i);
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++) k.m[a][b] += k1.m[b][a];
    }
    return k;
}

/* ---- assembly ---- */

/* out += s * a at row i, column j (in 3x3 blocks) of a row-major matrix with `columns` columns */
static void dgfemi_add_block(dgfem_real *out, int columns, int i, int j, dgfem_real s, const dgfem_mat3 *a) {
    dgfem_real *row = out + 3 * i * columns + 3 * j;
    for (int p = 0; p < 3; p++, row += columns)
        for (int q = 0; q < 3; q++) row[q] += s * a->m[p][q];
}

static void dgfemi_add_image(dgfem_vec3 *out, const dgfem_mat3 *a, dgfem_vec3 v) {
    *out = dgfemi_add(*out, dgfemi_multiply(a, v));
}

static void dgfemi_assemble_element(const dgfem_body *body, int element, const dgfem_mat3 *r, dgfem_real s,
                                    dgfem_matrix *matrix, dgfem_vec3 *f0) {
    const dgfemi_element_form *form = &body->forms->elements[element];
    const dgfem_real *g = dgfemi_form_stiffness(body->forms, element);
    const dgfem_material *m = &body->material[element];
    dgfem_real lambda = dgfemi_lambda(m), mu = dgfemi_mu(m);
    dgfem_real *out = dgfem_matrix_block(matrix, element, element);
    dgfem_mat3 rt = dgfemi_transposed(r);
    dgfem_vec3 rest[3];
    dgfemi_rotated_rest(r, body->scale[element], rest);
    f0 += body->basis_start[element];
    for (int i = 1; i < form->count; i++)
        for (int j = 1; j < form->count; j++, g += 9) {
            dgfem_mat3 k = dgfemi_element_block(g, lambda, mu, r, &rt);
            dgfemi_add_block(out, 3 * form->count, i, j, s, &k);
            if (j <= 3) dgfemi_add_image(&f0[i], &k, rest[j - 1]);
        }
}

/* One of the four blocks of a face: rows of side r, columns of side s. */
static void dgfemi_assemble_quadrant(const dgfemi_warped_face *face, int r, int s, dgfem_real scale,
                                     dgfem_matrix *matrix) {
    const dgfemi_face_form *form = face->form;
    dgfem_real *out = dgfem_matrix_block(matrix, form->element[r], form->element[s]);
    for (int i = 0; i < form->count[r]; i++)
        for (int j = 0; j < form->count[s]; j++) {
            dgfem_mat3 k = dgfemi_face_block(face, r, i, s, j);
            dgfemi_add_block(out, 3 * form->count[s], i, j, scale, &k);
        }
}

/* f0 of the consistency terms of side s, for the rows of both sides. */
static void dgfemi_face_rest_force(const dgfem_body *body, const dgfemi_warped_face *face, int s,
                                   const dgfem_mat3 *rotation, dgfem_vec3 *f0) {
    const dgfemi_face_form *form = face->form;
    dgfem_vec3 rest[3];
    int element = form->element[s];
    dgfemi_rotated_rest(&rotation[element], body->scale[element], rest);
    for (int r = 0; r < 2 && form->element[r] != DGFEM_NONE; r++) {
        dgfem_vec3 *out = f0 + body->basis_start[form->element[r]];
        for (int i = 0; i < form->count[r]; i++)
            for (int j = 1; j <= 3; j++) {
                dgfem_mat3 k = dgfemi_consistency_block(face, s, r ? form->count[0] + i : i, j);
                dgfemi_add_image(&out[i], &k, rest[j - 1]);
            }
    }
}

/* Right-hand side of a held face: minus the column of the ghost times the prescribed displacement. */
static void dgfemi_held_force(const dgfem_body *body, const dgfemi_warped_face *face, dgfem_real load, dgfem_vec3 *f) {
    const dgfemi_face_form *form = face->form;
    const dgfem_vec3 *ghost = dgfemi_form_ghost(body->forms, form);
    f += body->basis_start[form->element[0]];
    for (int i = 0; i < form->count[0]; i++)
        for (int j = 0; j < form->count[1]; j++) {
            dgfem_mat3 k = dgfemi_face_block(face, 0, i, 1, j);
            dgfemi_add_image(&f[i], &k, dgfemi_scale(-load, ghost[j]));
        }
}

/* matrix = scale * K_w, f0 = warping's force plus `load` times the force of prescribed displacements. */
static void dgfemi_assemble_stiffness(const dgfem_body *body, const dgfem_mat3 *rotation, dgfem_real scale, dgfem_real load,
                            dgfem_matrix *matrix, dgfem_vec3 *f0) {
    const dgfem_forms *forms = body->forms;
    dgfemi_warped_face face;
    dgfem_matrix_clear(matrix);
    memset(f0, 0, (size_t)body->basis_count * sizeof *f0);
    for (int e = 0; e < body->mesh->element_count; e++)
        dgfemi_assemble_element(body, e, &rotation[e], scale, matrix, f0);
    for (int f = 0; f < forms->face_count; f++) {
        const dgfemi_face_form *form = &forms->faces[f];
        dgfemi_warp_face(body, form, rotation, &face);
        dgfemi_assemble_quadrant(&face, 0, 0, scale, matrix);
        if (form->element[1] != DGFEM_NONE) {
            dgfemi_assemble_quadrant(&face, 1, 1, scale, matrix);
            int lower = form->element[1] > form->element[0];
            dgfemi_assemble_quadrant(&face, lower, !lower, scale, matrix);
        } else {
            dgfemi_held_force(body, &face, load, f0);
        }
        for (int s = 0; s < 2 && body->desc.warp; s++)
            if (dgfemi_form_has_traction(form, s)) dgfemi_face_rest_force(body, &face, s, rotation, f0);
    }
}

/* Adds s * (mass matrix) to the diagonal blocks. */
static void dgfemi_assemble_mass(const dgfem_body *body, dgfem_real s, dgfem_matrix *matrix) {
    for (int e = 0; e < body->mesh->element_count; e++) {
        const dgfemi_element_form *form = &body->forms->elements[e];
        const dgfem_real *mass = dgfemi_form_mass(body->forms, e);
        dgfem_real *out = dgfem_matrix_block(matrix, e, e), factor = s * body->material[e].density;
        int n = form->count;
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++)
                for (int a = 0; a < 3; a++) out[(3 * i + a) * 3 * n + 3 * j + a] += factor * mass[i * n + j];
    }
}

/* out += s M v */
static void dgfemi_add_mass_product(const dgfem_body *body, dgfem_real s, const dgfem_vec3 *v, dgfem_vec3 *out) {
    for (int e = 0; e < body->mesh->element_count; e++) {
        const dgfemi_element_form *form = &body->forms->elements[e];
        const dgfem_real *mass = dgfemi_form_mass(body->forms, e);
        dgfem_real factor = s * body->material[e].density;
        int start = body->basis_start[e];
        for (int i = 0; i < form->count; i++)
            for (int j = 0; j < form->count; j++)
                out[start + i] =
                    dgfemi_add_scaled(out[start + i], factor * mass[i * form->count + j], v[start + j]);
    }
}

/* ---- force and energy without a matrix ---- */

/* U - (R - I) X0: the displacement seen in the rotated frame, turned back to world axes. */
static void dgfemi_strained(const dgfem_body *body, int element, const dgfem_mat3 *r, dgfem_vec3 *out) {
    const dgfem_vec3 *u = body->displacement + body->basis_start[element];
    dgfem_vec3 rest[3];
    dgfemi_rotated_rest(r, body->scale[element], rest);
    for (int j = 0; j < body->forms->elements[element].count; j++)
        out[j] = j >= 1 && j <= 3 ? dgfemi_sub(u[j], rest[j - 1]) : u[j];
}

/* Elastic energy of one element; adds its internal force K_w U - f0 where `force` is not NULL. */
static dgfem_real dgfemi_element_energy(const dgfem_body *body, int element, const dgfem_mat3 *r, dgfem_vec3 *force) {
    const dgfemi_element_form *form = &body->forms->elements[element];
    const dgfem_real *g = dgfemi_form_stiffness(body->forms, element);
    const dgfem_material *m = &body->material[element];
    dgfem_real lambda = dgfemi_lambda(m), mu = dgfemi_mu(m), energy = 0;
    dgfem_mat3 rt = dgfemi_transposed(r);
    dgfem_vec3 strained[DGFEM_MAX_BASIS];
    dgfemi_strained(body, element, r, strained);
    for (int i = 1; i < form->count; i++) {
        dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
        for (int j = 1; j < form->count; j++, g += 9) {
            dgfem_mat3 k = dgfemi_element_block(g, lambda, mu, r, &rt);
            dgfemi_add_image(&sum, &k, strained[j]);
        }
        energy += dgfemi_dot(strained[i], sum) / 2;
        if (force) force[body->basis_start[element] + i] = dgfemi_add(force[body->basis_start[element] + i], sum);
    }
    return energy;
}

/* The same of one face. With U the displacement and U' its strained part (the ghost's is U itself):
   force = K3 U + K1' U' + K1'^T U, energy = U.K3 U / 2 + U.K1' U'. */
static dgfem_real dgfemi_face_energy(const dgfem_body *body, const dgfemi_warped_face *face, const dgfem_mat3 *rotation,
                                     dgfem_vec3 *force) {
    const dgfemi_face_form *form = face->form;
    dgfem_vec3 strained[2][DGFEM_MAX_BASIS];
    const dgfem_vec3 *u[2];
    dgfem_real energy = 0;
    for (int s = 0; s < 2; s++) {
        int e = form->element[s];
        u[s] = e == DGFEM_NONE ? dgfemi_form_ghost(body->forms, form) : body->displacement + body->basis_start[e];
        if (e != DGFEM_NONE) dgfemi_strained(body, e, &rotation[e], strained[s]);
    }
    for (int r = 0; r < 2; r++)
        for (int i = 0; i < form->count[r]; i++) {
            dgfem_vec3 penalty = dgfemi_vec3(0, 0, 0), traction = penalty, adjoint = penalty;
            for (int s = 0; s < 2; s++)
                for (int j = 0; j < form->count[s]; j++) {
                    int row = r ? form->count[0] + i : i, column = s ? form->count[0] + j : j;
                    dgfem_mat3 k = dgfemi_jump_block(face, row, column);
                    dgfemi_add_image(&penalty, &k, u[s][j]);
                    if (j > 0 && dgfemi_form_has_traction(form, s)) {
                        k = dgfemi_consistency_block(face, s, row, j);
                        dgfemi_add_image(&traction, &k, strained[s][j]);
                    }
                    if (i > 0 && dgfemi_form_has_traction(form, r)) {
                        k = dgfemi_consistency_block(face, r, column, i);
                        adjoint = dgfemi_add(adjoint, dgfemi_multiply_transposed(&k, u[s][j]));
                    }
                }
            energy += dgfemi_dot(u[r][i], dgfemi_add_scaled(traction, DGFEM_R(0.5), penalty));
            if (force && form->element[r] != DGFEM_NONE) {
                dgfem_vec3 *out = &force[body->basis_start[form->element[r]] + i];
                *out = dgfemi_add(*out, dgfemi_add(penalty, dgfemi_add(traction, adjoint)));
            }
        }
    return energy;
}

static dgfem_real dgfemi_elastic_energy(const dgfem_body *body, const dgfem_mat3 *rotation, dgfem_vec3 *force) {
    dgfemi_warped_face face;
    dgfem_real energy = 0;
    for (int e = 0; e < body->mesh->element_count; e++)
        energy += dgfemi_element_energy(body, e, &rotation[e], force);
    for (int f = 0; f < body->forms->face_count; f++) {
        dgfemi_warp_face(body, &body->forms->faces[f], rotation, &face);
        energy += dgfemi_face_energy(body, &face, rotation, force);
    }
    return energy;
}

/* ==== body.c ====================================================================================================== */

/* State of a solid: descriptors, creation, the block system and its solver. */

DGFEM_API dgfem_body_desc dgfem_default_body_desc(void) {
    dgfem_body_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.material.young = DGFEM_R(1e6);
    desc.material.poisson = DGFEM_R(0.3);
    desc.material.density = 1000;
    desc.degree = 1;
    desc.flux = DGFEM_FLUX_IP;
    desc.penalty = DGFEM_PENALTY_SPLIT;
    desc.eta = 4;
    desc.eta_rest = DGFEM_R(0.5);
    desc.gravity.z = DGFEM_R(-9.81);
    desc.warp = 1;
    desc.solver = DGFEM_SOLVER_CHOLESKY;
    desc.solver_tolerance = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-6);
    desc.solver_iterations = 1000;
    return desc;
}

DGFEM_API dgfem_static_desc dgfem_default_static_desc(void) {
    dgfem_static_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.load_steps = 1;
    desc.max_sweeps = 60;
    desc.tolerance = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-9);
    return desc;
}

DGFEM_API dgfem_shape_desc dgfem_default_shape_desc(void) {
    dgfem_shape_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.plane.normal.z = 1;
    desc.radius = 1;
    desc.stiffness = 10;
    desc.damping = DGFEM_R(0.005);
    desc.friction = DGFEM_R(0.5);
    desc.slip_speed = DGFEM_R(1e-3);
    return desc;
}

/* ---- creation ---- */

static dgfem_status dgfemi_check_material(const dgfem_hooks *hooks, const dgfem_material *m, int element) {
    if (!(m->young > 0) || !dgfemi_is_finite(m->young))
        return dgfemi_fail(hooks, DGFEM_ERROR_MATERIAL, "element %d: Young's modulus %g, expected > 0", element,
                           (double)m->young);
    if (!(m->poisson > -1 && m->poisson < DGFEM_R(0.5)))
        return dgfemi_fail(hooks, DGFEM_ERROR_MATERIAL, "element %d: Poisson's ratio %g, expected in (-1, 0.5)", element,
                           (double)m->poisson);
    if (!(m->density > 0) || !dgfemi_is_finite(m->density))
        return dgfemi_fail(hooks, DGFEM_ERROR_MATERIAL, "element %d: density %g, expected > 0", element,
                           (double)m->density);
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_not_negative(const dgfem_hooks *hooks, dgfem_real value, const char *what) {
    if (value >= 0 && dgfemi_is_finite(value)) return DGFEM_OK;
    return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s is %g, expected >= 0", what, (double)value);
}

static dgfem_status dgfemi_check_positive(const dgfem_hooks *hooks, dgfem_real value, const char *what) {
    if (value > 0 && dgfemi_is_finite(value)) return DGFEM_OK;
    return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s is %g, expected > 0", what, (double)value);
}

static dgfem_status dgfemi_check_body_scalars(const dgfem_body_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    dgfem_status status = dgfemi_check_positive(hooks, desc->eta, "eta");
    if (!status) status = dgfemi_check_not_negative(hooks, desc->eta_rest, "eta_rest");
    if (!status) status = dgfemi_check_not_negative(hooks, desc->damping_mass, "damping_mass");
    if (!status) status = dgfemi_check_not_negative(hooks, desc->damping_stiffness, "damping_stiffness");
    if (!status) status = dgfemi_check_positive(hooks, desc->solver_tolerance, "solver_tolerance");
    if (!status && !dgfemi_is_finite3(desc->gravity))
        status = dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "gravity (%g, %g, %g)", (double)desc->gravity.x,
                             (double)desc->gravity.y, (double)desc->gravity.z);
    if (!status && desc->solver_iterations < 1)
        status = dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "solver_iterations is %d, expected >= 1",
                             desc->solver_iterations);
    if (!status && (desc->flux != DGFEM_FLUX_IP && desc->flux != DGFEM_FLUX_BZ))
        status = dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "unknown flux %d", (int)desc->flux);
    if (!status && ((int)desc->penalty < 0 || desc->penalty > DGFEM_PENALTY_SCALAR))
        status = dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "unknown penalty %d", (int)desc->penalty);
    if (!status && desc->solver != DGFEM_SOLVER_CHOLESKY && desc->solver != DGFEM_SOLVER_PCG)
        status = dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "unknown solver %d", (int)desc->solver);
    return status;
}

static dgfem_status dgfemi_check_body_desc(const dgfem_body_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    if (!desc->mesh) return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "body: no mesh");
    if (desc->mesh->element_count < 1) return dgfemi_fail(hooks, DGFEM_ERROR_EMPTY, "body: the mesh has no elements");
    dgfem_status status = dgfemi_check_body_scalars(desc);
    for (int e = 0; !status && e < desc->mesh->element_count; e++) {
        int degree = desc->degrees ? desc->degrees[e] : desc->degree;
        status = dgfemi_check_material(hooks, desc->materials ? &desc->materials[e] : &desc->material, e);
        if (!status && (degree < 1 || degree > DGFEM_MAX_DEGREE))
            status = dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "element %d: degree %d, expected 1..%d", e, degree,
                                 DGFEM_MAX_DEGREE);
        if (!status && !(desc->mesh->elements[e].volume > 0 && desc->mesh->elements[e].radius > 0))
            status = dgfemi_fail(hooks, DGFEM_ERROR_DEGENERATE, "element %d has the volume %g", e,
                                 (double)desc->mesh->elements[e].volume);
    }
    return status;
}

/* The arrays that have one entry per element or per basis function. 0 when out of memory. */
static int dgfemi_body_allocate(dgfem_body *body, int elements) {
    const dgfem_hooks *hooks = &body->hooks;
    size_t n = (size_t)elements;
    body->degree = (int *)dgfemi_allocate(hooks, n, sizeof(int));
    body->material = (dgfem_material *)dgfemi_allocate(hooks, n, sizeof(dgfem_material));
    body->origin = (dgfem_vec3 *)dgfemi_allocate(hooks, n, sizeof(dgfem_vec3));
    body->scale = (dgfem_real *)dgfemi_allocate(hooks, n, sizeof(dgfem_real));
    body->rotation = (dgfem_mat3 *)dgfemi_allocate(hooks, 2 * n, sizeof(dgfem_mat3));
    body->basis_start = (int *)dgfemi_allocate(hooks, n + 1, sizeof(int));
    return body->degree && body->material && body->origin && body->scale && body->rotation && body->basis_start;
}

static int dgfemi_body_allocate_state(dgfem_body *body) {
    const dgfem_hooks *hooks = &body->hooks;
    size_t n = (size_t)body->basis_count;
    body->displacement = (dgfem_vec3 *)dgfemi_allocate_zero(hooks, n, sizeof(dgfem_vec3));
    body->velocity = (dgfem_vec3 *)dgfemi_allocate_zero(hooks, n, sizeof(dgfem_vec3));
    body->force = (dgfem_vec3 *)dgfemi_allocate_zero(hooks, n, sizeof(dgfem_vec3));
    return body->displacement && body->velocity && body->force;
}

static void dgfemi_body_set_elements(dgfem_body *body, const dgfem_body_desc *desc) {
    int start = 0;
    for (int e = 0; e < desc->mesh->element_count; e++) {
        body->degree[e] = desc->degrees ? desc->degrees[e] : desc->degree;
        body->material[e] = desc->materials ? desc->materials[e] : desc->material;
        body->origin[e] = desc->mesh->elements[e].centre;
        body->scale[e] = desc->mesh->elements[e].radius;
        body->rotation[e] = dgfemi_identity();
        body->basis_start[e] = start;
        start += dgfem_monomial_count(body->degree[e]);
    }
    body->basis_start[desc->mesh->element_count] = start;
    body->basis_count = start;
}

/* The block matrix of the element graph: elements coupled through glued faces. */
static dgfem_status dgfemi_body_create_matrix(dgfem_body *body) {
    const dgfem_mesh *mesh = body->mesh;
    dgfemi_arena arena = dgfemi_arena_make(&body->hooks);
    dgfem_matrix_desc desc = dgfem_default_matrix_desc();
    int *sizes = (int *)dgfemi_arena_allocate(&arena, (size_t)mesh->element_count, sizeof(int));
    int *pairs = (int *)dgfemi_arena_allocate(&arena, 2 * (size_t)mesh->face_count, sizeof(int));
    dgfem_status status = DGFEM_ERROR_MEMORY;
    if (sizes && pairs) {
        for (int e = 0; e < mesh->element_count; e++) sizes[e] = 3 * dgfem_monomial_count(body->degree[e]);
        for (int f = 0; f < mesh->face_count; f++) {
            const dgfem_face *face = &mesh->faces[f];
            if (face->element[1] == DGFEM_NONE || face->cut) continue;
            pairs[2 * desc.pair_count] = face->element[0];
            pairs[2 * desc.pair_count++ + 1] = face->element[1];
        }
        desc.block_count = mesh->element_count;
        desc.block_sizes = sizes;
        desc.pairs = pairs;
        desc.centres = body->origin;
        desc.hooks = body->hooks;
        status = dgfem_matrix_create(&desc, &body->matrix);
    }
    dgfemi_arena_free(&arena);
    return status;
}

/* Work vectors of a step, in units of basis_count vectors; PCG's own work follows. */
enum { DGFEMI_WORK_F0, DGFEMI_WORK_RHS, DGFEMI_WORK_X, DGFEMI_WORK_Y, DGFEMI_WORK_COUNT };

static dgfem_vec3 *dgfemi_work(const dgfem_body *body, int k) {
    return (dgfem_vec3 *)(void *)body->work + (size_t)k * (size_t)body->basis_count;
}

static dgfem_status dgfemi_body_create_solver(dgfem_body *body) {
    size_t vectors = DGFEMI_WORK_COUNT * 3 * (size_t)body->basis_count;
    dgfem_status status = dgfemi_body_create_matrix(body);
    if (status) return status;
    if (body->desc.solver == DGFEM_SOLVER_PCG) {
        vectors += dgfem_pcg_work_size(body->matrix);
    } else {
        dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
        desc.hooks = body->hooks;
        status = dgfem_cholesky_create(body->matrix, &desc, &body->cholesky);
        if (status) return status;
    }
    body->work = (dgfem_real *)dgfemi_allocate(&body->hooks, vectors, sizeof(dgfem_real));
    return body->work ? DGFEM_OK : DGFEM_ERROR_MEMORY;
}

static dgfem_status dgfemi_body_build(dgfem_body *body, const dgfem_body_desc *desc) {
    if (!dgfemi_body_allocate(body, desc->mesh->element_count)) return DGFEM_ERROR_MEMORY;
    dgfemi_body_set_elements(body, desc);
    if (!dgfemi_body_allocate_state(body)) return DGFEM_ERROR_MEMORY;
    body->forms = dgfemi_forms_create(body);
    if (!body->forms) return DGFEM_ERROR_MEMORY;
    return dgfemi_body_create_solver(body);
}

static void dgfemi_condition_free(const dgfem_hooks *hooks, dgfem_condition *condition) {
    dgfemi_free(hooks, condition->items);
    dgfemi_free(hooks, condition->values);
}

/* Frees everything but the mesh. */
static void dgfemi_body_free(dgfem_body *body) {
    dgfem_hooks hooks = body->hooks;
    for (int i = 0; i < body->condition_count; i++) dgfemi_condition_free(&hooks, &body->conditions[i]);
    dgfemi_free(&hooks, body->conditions);
    dgfemi_free(&hooks, body->shapes);
    dgfemi_free(&hooks, body->degree);
    dgfemi_free(&hooks, body->material);
    dgfemi_free(&hooks, body->origin);
    dgfemi_free(&hooks, body->scale);
    dgfemi_free(&hooks, body->rotation);
    dgfemi_free(&hooks, body->basis_start);
    dgfemi_free(&hooks, body->displacement);
    dgfemi_free(&hooks, body->velocity);
    dgfemi_free(&hooks, body->force);
    dgfemi_free(&hooks, body->work);
    dgfemi_forms_destroy(body->forms, &hooks);
    dgfemi_contacts_destroy(body->contacts);
    dgfem_matrix_destroy(body->matrix);
    dgfem_cholesky_destroy(body->cholesky);
    dgfemi_free(&hooks, body);
}

DGFEM_API dgfem_status dgfem_body_create(const dgfem_body_desc *desc, dgfem_body **out) {
    if (!out) return DGFEM_ERROR_ARGUMENT;
    *out = NULL;
    dgfem_status status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (status) return status;
    status = dgfemi_check_body_desc(desc);
    if (status) return status;
    dgfem_body *body = (dgfem_body *)dgfemi_allocate_zero(&desc->hooks, 1, sizeof *body);
    if (!body) return dgfemi_fail_memory(&desc->hooks);
    body->desc = *desc;
    body->desc.materials = NULL; /* the caller's arrays need not outlive this call */
    body->desc.degrees = NULL;
    body->hooks = desc->hooks;
    body->mesh = desc->mesh;
    status = dgfemi_body_build(body, desc);
    if (status) {
        dgfemi_body_free(body);
        return status == DGFEM_ERROR_MEMORY ? dgfemi_fail_memory(&desc->hooks) : status;
    }
    *out = body;
    return DGFEM_OK;
}

DGFEM_API void dgfem_body_destroy(dgfem_body *body) {
    if (!body) return;
    dgfem_mesh_destroy(body->mesh);
    dgfemi_body_free(body);
}

/* ---- fields ---- */

static dgfem_vec3 dgfemi_evaluate(const dgfem_body *body, const dgfem_vec3 *coefficients, int element, dgfem_vec3 x) {
    dgfem_real n[DGFEM_MAX_BASIS];
    dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
    int start = body->basis_start[element];
    dgfemi_basis_evaluate(body->degree[element], body->origin[element], body->scale[element], x, n);
    for (int i = 0; i < body->basis_start[element + 1] - start; i++)
        sum = dgfemi_add_scaled(sum, n[i], coefficients[start + i]);
    return sum;
}

/* Coefficients of value(x) = translation + linear x in one element. */
static void dgfemi_affine_element(const dgfem_body *body, int element, const dgfem_mat3 *linear, dgfem_vec3 translation,
                                  dgfem_vec3 *coefficients) {
    memset(coefficients, 0, (size_t)dgfem_monomial_count(body->degree[element]) * sizeof *coefficients);
    coefficients[0] = dgfemi_add(translation, dgfemi_multiply(linear, body->origin[element]));
    for (int j = 0; j < 3; j++) coefficients[1 + j] = dgfemi_scale(body->scale[element], dgfemi_column(linear, j));
}

static dgfem_status dgfemi_check_affine(const dgfem_body *body, const dgfem_mat3 *linear, dgfem_vec3 translation) {
    if (dgfemi_is_finite_mat3(linear) && dgfemi_is_finite3(translation)) return DGFEM_OK;
    return dgfemi_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "affine field");
}

/* ==== load.c ====================================================================================================== */

/* What acts on a solid: conditions (held faces and elements, pins, loads), contact shapes and points. */

/* ---- the list of conditions ---- */

static dgfem_condition *dgfemi_find_condition(const dgfem_body *body, int id) {
    for (int i = 0; i < body->condition_count; i++)
        if (body->conditions[i].id == id) return &body->conditions[i];
    return NULL;
}

/* The condition with this id, if it is of this kind; else NULL and a log line. */
static dgfem_condition *dgfemi_expect_condition(const dgfem_body *body, int id, dgfem_condition_kind kind) {
    dgfem_condition *condition = dgfemi_find_condition(body, id);
    if (condition && condition->kind == kind) return condition;
    (void)dgfemi_fail(&body->hooks, DGFEM_ERROR_INDEX, "there is no condition of that kind with the id %d", id);
    return NULL;
}

static dgfem_status dgfemi_check_items(const dgfem_body *body, const int *items, int count, int limit,
                                       const char *what) {
    if (!items || count < 1) return dgfemi_fail(&body->hooks, DGFEM_ERROR_EMPTY, "condition on %d %ss", count, what);
    for (int i = 0; i < count; i++)
        if (items[i] < 0 || items[i] >= limit)
            return dgfemi_fail(&body->hooks, DGFEM_ERROR_INDEX, "%s %d, expected 0..%d", what, items[i], limit - 1);
    return DGFEM_OK;
}

static dgfem_status dgfemi_check_elements(const dgfem_body *body, const int *elements, int count) {
    return dgfemi_check_items(body, elements, count, body->mesh->element_count, "element");
}

static dgfem_status dgfemi_check_boundary_faces(const dgfem_body *body, const int *faces, int count) {
    dgfem_status status = dgfemi_check_items(body, faces, count, body->mesh->face_count, "face");
    for (int i = 0; !status && i < count; i++)
        if (body->mesh->faces[faces[i]].element[1] != DGFEM_NONE)
            status = dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "face %d lies between two elements", faces[i]);
    return status;
}

static dgfem_status dgfemi_check_finite(const dgfem_body *body, dgfem_vec3 v, const char *what) {
    if (dgfemi_is_finite3(v)) return DGFEM_OK;
    return dgfemi_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "%s (%g, %g, %g)", what, (double)v.x, (double)v.y,
                       (double)v.z);
}

/* Room for one more condition, with a copy of its items: the last place of the list, not yet counted. NULL when out of
   memory. */
static dgfem_condition *dgfemi_reserve_condition(dgfem_body *body, dgfem_condition_kind kind, const int *items,
                                                 int count) {
    if (body->condition_count == body->condition_capacity) {
        void *grown = dgfemi_grow(&body->hooks, body->conditions, &body->condition_capacity, body->condition_count + 1,
                                  sizeof *body->conditions);
        if (!grown) return NULL;
        body->conditions = (dgfem_condition *)grown;
    }
    dgfem_condition *condition = &body->conditions[body->condition_count];
    memset(condition, 0, sizeof *condition);
    condition->id = body->next_id;
    condition->kind = kind;
    condition->count = count;
    condition->items = (int *)dgfemi_duplicate(&body->hooks, items, (size_t)count, sizeof(int));
    return condition->items ? condition : NULL;
}

/* Counts the condition reserved last. */
static dgfem_status dgfemi_accept_condition(dgfem_body *body, int *id) {
    if (id) *id = body->next_id;
    body->condition_count++;
    body->next_id++;
    return DGFEM_OK;
}

/* ---- held faces ---- */

static dgfem_status dgfemi_check_free_faces(const dgfem_body *body, const int *faces, int count) {
    dgfem_status status = dgfemi_check_boundary_faces(body, faces, count);
    if (status) return status;
    dgfemi_arena arena = dgfemi_arena_make(&body->hooks);
    char *held = (char *)dgfemi_arena_allocate_zero(&arena, (size_t)body->mesh->face_count, 1);
    if (!held) return dgfemi_fail_memory(&body->hooks);
    for (int f = 0; f < body->forms->face_count; f++) held[body->forms->faces[f].face] = 1;
    for (int i = 0; !status && i < count; i++) {
        if (held[faces[i]])
            status = dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "face %d is held already", faces[i]);
        held[faces[i]] = 1;
    }
    dgfemi_arena_free(&arena);
    return status;
}

static void dgfemi_constant_displacement(void *user, dgfem_vec3 rest, dgfem_vec3 *displacement) {
    (void)rest;
    *displacement = *(const dgfem_vec3 *)user;
}

/* Samples the prescribed displacement on the faces of a condition. On failure the ghosts may be half set: callers
   remove or restore them. */
static dgfem_status dgfemi_sample_ghosts(dgfem_body *body, dgfem_condition *condition) {
    dgfem_status status = DGFEM_OK;
    for (int f = 0; !status && f < body->forms->face_count; f++) {
        const dgfemi_face_form *form = &body->forms->faces[f];
        if (form->condition != condition->id) continue;
        dgfem_vec3 *ghost = dgfemi_form_ghost(body->forms, form);
        status = condition->fn
                     ? dgfemi_forms_set_ghost(body, form, condition->fn, condition->fn_user, ghost)
                     : dgfemi_forms_set_ghost(body, form, dgfemi_constant_displacement, &condition->vector, ghost);
    }
    return status;
}

/* Adds the face forms of the condition reserved last, all or none, and counts it. */
static dgfem_status dgfemi_hold_faces(dgfem_body *body, dgfem_condition *condition, int *id) {
    dgfem_status status = DGFEM_OK;
    int normal_only = condition->kind == DGFEM_CONDITION_FIX_NORMAL;
    for (int i = 0; !status && i < condition->count; i++)
        if (dgfemi_forms_add_face(body, body->forms, condition->items[i], condition->id, normal_only) == DGFEM_NONE)
            status = dgfemi_fail_memory(&body->hooks);
    if (!status) status = dgfemi_sample_ghosts(body, condition);
    if (!status) return dgfemi_accept_condition(body, id);
    dgfemi_forms_remove_condition(body->forms, &body->hooks, condition->id);
    dgfemi_condition_free(&body->hooks, condition);
    return status;
}

static dgfem_status dgfemi_fix_faces(dgfem_body *body, dgfem_condition_kind kind, const int *faces, int count,
                                     dgfem_vec3 displacement, dgfem_displacement_fn fn, void *user, int *id) {
    dgfem_status status = dgfemi_check_free_faces(body, faces, count);
    if (status) return status;
    dgfem_condition *condition = dgfemi_reserve_condition(body, kind, faces, count);
    if (!condition) return dgfemi_fail_memory(&body->hooks);
    condition->vector = displacement;
    condition->fn = fn;
    condition->fn_user = user;
    return dgfemi_hold_faces(body, condition, id);
}

DGFEM_API dgfem_status dgfem_body_fix_faces(dgfem_body *body, const int *faces, int face_count, dgfem_vec3 displacement,
                                            int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_finite(body, displacement, "fix_faces: displacement");
    if (status) return status;
    return dgfemi_fix_faces(body, DGFEM_CONDITION_FIX_FACES, faces, face_count, displacement, NULL, NULL, id);
}

DGFEM_API dgfem_status dgfem_body_fix_faces_fn(dgfem_body *body, const int *faces, int face_count,
                                               dgfem_displacement_fn fn, void *user, int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!fn) return dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "fix_faces_fn: no function");
    return dgfemi_fix_faces(body, DGFEM_CONDITION_FIX_FACES, faces, face_count, dgfemi_vec3(0, 0, 0), fn, user, id);
}

DGFEM_API dgfem_status dgfem_body_fix_normal(dgfem_body *body, const int *faces, int face_count, int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    return dgfemi_fix_faces(body, DGFEM_CONDITION_FIX_NORMAL, faces, face_count, dgfemi_vec3(0, 0, 0), NULL, NULL, id);
}

DGFEM_API dgfem_status dgfem_body_move_fixture(dgfem_body *body, int id, dgfem_vec3 displacement) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_finite(body, displacement, "move_fixture: displacement");
    if (status) return status;
    dgfem_condition *condition = dgfemi_expect_condition(body, id, DGFEM_CONDITION_FIX_FACES);
    if (!condition) return DGFEM_ERROR_INDEX;
    condition->vector = displacement;
    condition->fn = NULL;
    return dgfemi_sample_ghosts(body, condition); /* cannot fail: the value is finite */
}

DGFEM_API dgfem_status dgfem_body_resample_fixture(dgfem_body *body, int id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_condition *condition = dgfemi_expect_condition(body, id, DGFEM_CONDITION_FIX_FACES);
    if (!condition) return DGFEM_ERROR_INDEX;
    dgfem_vec3 ghost[DGFEM_MAX_BASIS];
    for (int f = 0; condition->fn && f < body->forms->face_count; f++) { /* a first pass that only looks for NaN */
        const dgfemi_face_form *form = &body->forms->faces[f];
        if (form->condition != id) continue;
        dgfem_status status = dgfemi_forms_set_ghost(body, form, condition->fn, condition->fn_user, ghost);
        if (status) return status;
    }
    return dgfemi_sample_ghosts(body, condition);
}

/* ---- held elements ---- */

static dgfem_status dgfemi_check_free_elements(const dgfem_body *body, const int *elements, int count) {
    dgfem_status status = dgfemi_check_elements(body, elements, count);
    for (int c = 0; !status && c < body->condition_count; c++) {
        const dgfem_condition *condition = &body->conditions[c];
        if (condition->kind != DGFEM_CONDITION_FIX_ELEMENTS) continue;
        for (int i = 0; !status && i < condition->count; i++)
            for (int k = 0; !status && k < count; k++)
                if (condition->items[i] == elements[k])
                    status = dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "element %d is held already", elements[k]);
    }
    return status;
}

static int dgfemi_element_basis(const dgfem_body *body, int element) {
    return body->basis_start[element + 1] - body->basis_start[element];
}

DGFEM_API dgfem_status dgfem_body_fix_elements(dgfem_body *body, const int *elements, int element_count, int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_free_elements(body, elements, element_count);
    if (status) return status;
    size_t values = 0;
    dgfem_condition *condition = dgfemi_reserve_condition(body, DGFEM_CONDITION_FIX_ELEMENTS, elements, element_count);
    if (!condition) return dgfemi_fail_memory(&body->hooks);
    for (int i = 0; i < element_count; i++) values += (size_t)dgfemi_element_basis(body, elements[i]);
    condition->values = (dgfem_vec3 *)dgfemi_allocate(&body->hooks, values, sizeof(dgfem_vec3));
    if (!condition->values) {
        dgfemi_condition_free(&body->hooks, condition);
        return dgfemi_fail_memory(&body->hooks);
    }
    dgfem_vec3 *value = condition->values;
    for (int i = 0; i < element_count; i++)
        for (int k = body->basis_start[elements[i]]; k < body->basis_start[elements[i] + 1]; k++)
            *value++ = body->displacement[k];
    return dgfemi_accept_condition(body, id);
}

DGFEM_API dgfem_status dgfem_body_move_elements(dgfem_body *body, int id, dgfem_mat3 linear, dgfem_vec3 translation) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_affine(body, &linear, translation);
    if (status) return status;
    dgfem_condition *condition = dgfemi_expect_condition(body, id, DGFEM_CONDITION_FIX_ELEMENTS);
    if (!condition) return DGFEM_ERROR_INDEX;
    dgfem_vec3 *values = condition->values;
    for (int i = 0; i < condition->count; i++) {
        dgfemi_affine_element(body, condition->items[i], &linear, translation, values);
        values += dgfemi_element_basis(body, condition->items[i]);
    }
    return DGFEM_OK;
}

/* ---- forces ---- */

static void dgfemi_add_traction(const dgfem_body *body, int face, dgfem_vec3 traction, dgfem_vec3 *force) {
    dgfem_real moments[DGFEM_MAX_MOMENTS];
    int e = body->mesh->faces[face].element[0];
    dgfemi_mesh_face_moments(body->mesh, face, body->degree[e], body->origin[e], body->scale[e], moments);
    for (int i = body->basis_start[e]; i < body->basis_start[e + 1]; i++)
        force[i] = dgfemi_add_scaled(force[i], moments[i - body->basis_start[e]], traction);
}

static void dgfemi_add_body_force(const dgfem_body *body, int element, dgfem_vec3 density, dgfem_vec3 *force) {
    const dgfem_real *load = dgfemi_form_load(body->forms, element);
    for (int i = body->basis_start[element]; i < body->basis_start[element + 1]; i++)
        force[i] = dgfemi_add_scaled(force[i], load[i - body->basis_start[element]], density);
}

static void dgfemi_add_point_force(const dgfem_body *body, int element, dgfem_vec3 rest, dgfem_vec3 point_force,
                                   dgfem_vec3 *force) {
    dgfem_real n[DGFEM_MAX_BASIS];
    dgfemi_basis_evaluate(body->degree[element], body->origin[element], body->scale[element], rest, n);
    for (int i = body->basis_start[element]; i < body->basis_start[element + 1]; i++)
        force[i] = dgfemi_add_scaled(force[i], n[i - body->basis_start[element]], point_force);
}

/* Sums the loads that do not depend on the state. */
static void dgfemi_update_force(dgfem_body *body) {
    memset(body->force, 0, (size_t)body->basis_count * sizeof *body->force);
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_condition *condition = &body->conditions[c];
        for (int i = 0; i < condition->count; i++) {
            int item = condition->items[i];
            if (condition->kind == DGFEM_CONDITION_TRACTION)
                dgfemi_add_traction(body, item, condition->vector, body->force);
            else if (condition->kind == DGFEM_CONDITION_BODY_FORCE)
                dgfemi_add_body_force(body, item, condition->vector, body->force);
            else if (condition->kind == DGFEM_CONDITION_FORCE)
                dgfemi_add_point_force(body, item, condition->point, condition->vector, body->force);
        }
    }
}

/* out = gravity, dead loads and pressure, times `load`. Pressure acts along the normals turned with their elements. */
static void dgfemi_external_force(const dgfem_body *body, const dgfem_mat3 *rotation, dgfem_real load,
                                  dgfem_vec3 *out) {
    for (int i = 0; i < body->basis_count; i++) out[i] = dgfemi_scale(load, body->force[i]);
    for (int e = 0; e < body->mesh->element_count; e++)
        dgfemi_add_body_force(body, e, dgfemi_scale(load * body->material[e].density, body->desc.gravity), out);
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_condition *condition = &body->conditions[c];
        for (int i = 0; condition->kind == DGFEM_CONDITION_PRESSURE && i < condition->count; i++) {
            const dgfem_face *face = &body->mesh->faces[condition->items[i]];
            dgfem_vec3 normal = dgfemi_multiply(&rotation[face->element[0]], face->normal);
            dgfemi_add_traction(body, condition->items[i], dgfemi_scale(-load * condition->scalar, normal), out);
        }
    }
}

/* A load without further data than its items, a vector, a number and a point. */
static dgfem_status dgfemi_add_load(dgfem_body *body, dgfem_condition_kind kind, const int *items, int count,
                                    dgfem_vec3 vector, dgfem_real scalar, dgfem_vec3 point, int *id) {
    dgfem_condition *condition = dgfemi_reserve_condition(body, kind, items, count);
    if (!condition) return dgfemi_fail_memory(&body->hooks);
    condition->vector = vector;
    condition->scalar = scalar;
    condition->point = point;
    (void)dgfemi_accept_condition(body, id);
    dgfemi_update_force(body);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_body_set_traction(dgfem_body *body, const int *faces, int face_count, dgfem_vec3 traction,
                                               int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_boundary_faces(body, faces, face_count);
    if (!status) status = dgfemi_check_finite(body, traction, "traction");
    if (status) return status;
    return dgfemi_add_load(body, DGFEM_CONDITION_TRACTION, faces, face_count, traction, 0, dgfemi_vec3(0, 0, 0), id);
}

DGFEM_API dgfem_status dgfem_body_set_pressure(dgfem_body *body, const int *faces, int face_count, dgfem_real pressure,
                                               int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_vec3 none = dgfemi_vec3(0, 0, 0);
    dgfem_status status = dgfemi_check_boundary_faces(body, faces, face_count);
    if (!status) status = dgfemi_check_finite(body, dgfemi_vec3(pressure, 0, 0), "pressure");
    if (status) return status;
    return dgfemi_add_load(body, DGFEM_CONDITION_PRESSURE, faces, face_count, none, pressure, none, id);
}

DGFEM_API dgfem_status dgfem_body_set_body_force(dgfem_body *body, const int *elements, int element_count,
                                                 dgfem_vec3 density, int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_elements(body, elements, element_count);
    if (!status) status = dgfemi_check_finite(body, density, "body force");
    if (status) return status;
    return dgfemi_add_load(body, DGFEM_CONDITION_BODY_FORCE, elements, element_count, density, 0,
                           dgfemi_vec3(0, 0, 0), id);
}

DGFEM_API dgfem_status dgfem_body_add_force(dgfem_body *body, int element, dgfem_vec3 rest, dgfem_vec3 force, int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_elements(body, &element, 1);
    if (!status) status = dgfemi_check_finite(body, rest, "force: rest position");
    if (!status) status = dgfemi_check_finite(body, force, "force");
    if (status) return status;
    return dgfemi_add_load(body, DGFEM_CONDITION_FORCE, &element, 1, force, 0, rest, id);
}

/* ---- pins ---- */

DGFEM_API dgfem_status dgfem_body_pin(dgfem_body *body, int element, dgfem_vec3 rest, dgfem_real stiffness, int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_elements(body, &element, 1);
    if (!status) status = dgfemi_check_finite(body, rest, "pin: rest position");
    if (!status) status = dgfemi_check_positive(&body->hooks, stiffness, "pin: stiffness");
    if (status) return status;
    dgfem_vec3 place = dgfemi_add(rest, dgfemi_evaluate(body, body->displacement, element, rest));
    return dgfemi_add_load(body, DGFEM_CONDITION_PIN, &element, 1, place, stiffness, rest, id);
}

DGFEM_API dgfem_status dgfem_body_drag(dgfem_body *body, int id, dgfem_vec3 place) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_finite(body, place, "drag: place");
    if (status) return status;
    dgfem_condition *condition = dgfemi_expect_condition(body, id, DGFEM_CONDITION_PIN);
    if (!condition) return DGFEM_ERROR_INDEX;
    condition->vector = place;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_body_remove_condition(dgfem_body *body, int id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_condition *condition = dgfemi_find_condition(body, id);
    if (!condition) return dgfemi_fail(&body->hooks, DGFEM_ERROR_INDEX, "there is no condition with the id %d", id);
    dgfemi_forms_remove_condition(body->forms, &body->hooks, id);
    dgfemi_condition_free(&body->hooks, condition);
    for (body->condition_count--; condition < body->conditions + body->condition_count; condition++)
        *condition = condition[1];
    dgfemi_update_force(body);
    return DGFEM_OK;
}

/* ---- contact shapes ---- */

static dgfem_status dgfemi_check_shape(const dgfem_body *body, const dgfem_shape_desc *desc, dgfem_shape_kind kind) {
    const dgfem_hooks *hooks = &body->hooks;
    dgfem_status status = dgfemi_check_not_negative(hooks, desc->damping, "shape: damping");
    if (!status) status = dgfemi_check_not_negative(hooks, desc->friction, "shape: friction");
    if (!status) status = dgfemi_check_positive(hooks, desc->stiffness, "shape: stiffness");
    if (!status) status = dgfemi_check_positive(hooks, desc->slip_speed, "shape: slip_speed");
    if (status) return status;
    if (!dgfemi_is_finite3(desc->velocity)) return dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "shape: velocity");
    if (kind == DGFEM_SHAPE_PLANE) {
        if (!dgfemi_is_finite3(desc->plane.normal) || !dgfemi_is_finite(desc->plane.offset))
            return dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "shape: plane");
        if (!(dgfemi_norm(desc->plane.normal) > 0))
            return dgfemi_fail(hooks, DGFEM_ERROR_DEGENERATE, "shape: the plane's normal is zero");
        return DGFEM_OK;
    }
    if (!dgfemi_is_finite3(desc->centre) || !dgfemi_is_finite(desc->radius))
        return dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "shape: sphere");
    if (desc->radius == 0) return dgfemi_fail(hooks, DGFEM_ERROR_DEGENERATE, "shape: the sphere's radius is zero");
    return DGFEM_OK;
}

/* The desc with a plane of unit normal. */
static dgfem_shape_desc dgfemi_normalized_shape(const dgfem_shape_desc *desc) {
    dgfem_shape_desc result = *desc;
    dgfem_real length = dgfemi_norm(desc->plane.normal);
    if (length > 0) {
        result.plane.normal = dgfemi_normalized(desc->plane.normal);
        result.plane.offset /= length;
    }
    return result;
}

static dgfem_status dgfemi_body_need_contacts(dgfem_body *body) {
    return body->contacts ? DGFEM_OK : dgfemi_contacts_create(body, NULL, NULL, &body->contacts);
}

static dgfem_status dgfemi_add_shape(dgfem_body *body, const dgfem_shape_desc *desc, dgfem_shape_kind kind, int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (!status) status = dgfemi_check_shape(body, desc, kind);
    if (!status) status = dgfemi_body_need_contacts(body);
    if (status) return status;
    if (body->shape_count == body->shape_capacity) {
        void *grown =
            dgfemi_grow(&body->hooks, body->shapes, &body->shape_capacity, body->shape_count + 1, sizeof *body->shapes);
        if (!grown) return dgfemi_fail_memory(&body->hooks);
        body->shapes = (dgfem_shape *)grown;
    }
    dgfem_shape *shape = &body->shapes[body->shape_count++];
    shape->id = body->next_id++;
    shape->kind = kind;
    shape->desc = dgfemi_normalized_shape(desc);
    if (id) *id = shape->id;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_body_add_plane(dgfem_body *body, const dgfem_shape_desc *desc, int *id) {
    return dgfemi_add_shape(body, desc, DGFEM_SHAPE_PLANE, id);
}

DGFEM_API dgfem_status dgfem_body_add_sphere(dgfem_body *body, const dgfem_shape_desc *desc, int *id) {
    return dgfemi_add_shape(body, desc, DGFEM_SHAPE_SPHERE, id);
}

DGFEM_API dgfem_status dgfem_body_move_shape(dgfem_body *body, int id, const dgfem_shape_desc *desc) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (status) return status;
    for (int i = 0; i < body->shape_count; i++) {
        if (body->shapes[i].id != id) continue;
        status = dgfemi_check_shape(body, desc, body->shapes[i].kind);
        if (!status) body->shapes[i].desc = dgfemi_normalized_shape(desc);
        return status;
    }
    return dgfemi_fail(&body->hooks, DGFEM_ERROR_INDEX, "there is no shape with the id %d", id);
}

DGFEM_API dgfem_status dgfem_body_set_contact_points(dgfem_body *body, dgfem_points_in points, const dgfem_real *areas) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_contacts *contacts = NULL;
    dgfem_status status =
        dgfemi_check_points(&body->hooks, points.data, points.type, points.stride, points.count, "contact points");
    if (!status && points.count > 0 && !areas)
        status = dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "contact points: no areas");
    for (int i = 0; !status && i < points.count; i++) {
        if (!dgfemi_is_finite3(dgfemi_point_read(&points, i)))
            status = dgfemi_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "contact point %d", i);
        else if (!(areas[i] >= 0) || !dgfemi_is_finite(areas[i]))
            status = dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "contact point %d: area %g, expected >= 0", i,
                                 (double)areas[i]);
    }
    if (status) return status;
    status = points.count ? dgfemi_contacts_create(body, &points, areas, &contacts)
                          : dgfemi_contacts_create(body, NULL, NULL, &contacts);
    if (status) return status;
    dgfemi_contacts_destroy(body->contacts);
    body->contacts = contacts;
    return DGFEM_OK;
}

/* ==== solve.c ===================================================================================================== */

/* Moving a solid: the time step and the static solve. */

/* ---- the linear system ---- */

/* Element of an unknown block: they are numbered alike. */
static dgfem_status dgfemi_body_solve(dgfem_body *body, const dgfem_vec3 *rhs, dgfem_vec3 *x, dgfem_step_info *info) {
    const dgfem_hooks *hooks = &body->hooks;
    const dgfem_real *b = (const dgfem_real *)(const void *)rhs;
    dgfem_real *out = (dgfem_real *)(void *)x;
    double start = dgfemi_clock(hooks);
    dgfem_status status;
    if (body->desc.solver == DGFEM_SOLVER_PCG) {
        dgfem_pcg_desc desc = dgfem_default_pcg_desc();
        dgfem_pcg_info pcg;
        desc.tolerance = body->desc.solver_tolerance;
        desc.max_iterations = body->desc.solver_iterations;
        desc.work = (dgfem_real *)(void *)dgfemi_work(body, DGFEMI_WORK_COUNT);
        desc.hooks = *hooks;
        status = dgfem_pcg(body->matrix, &desc, b, out, &pcg);
        info->iterations += pcg.iterations;
        info->residual = pcg.residual;
        info->failed_element = pcg.failed_block;
        info->seconds_solve += dgfemi_clock(hooks) - start;
        return status;
    }
    dgfem_cholesky_info factor;
    status = dgfem_cholesky_factor(body->cholesky, body->matrix, &factor);
    double middle = dgfemi_clock(hooks);
    info->seconds_factor += middle - start;
    info->failed_element = factor.failed_block;
    if (!status) status = dgfem_cholesky_solve(body->cholesky, b, out);
    info->seconds_solve += dgfemi_clock(hooks) - middle;
    return status;
}

static dgfem_status dgfemi_check_solution(const dgfem_body *body, const dgfem_vec3 *x) {
    for (int e = 0; e < body->mesh->element_count; e++)
        for (int i = body->basis_start[e]; i < body->basis_start[e + 1]; i++)
            if (!dgfemi_is_finite3(x[i]))
                return dgfemi_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "solution in element %d", e);
    return DGFEM_OK;
}

/* The rotations being computed live behind the current ones until the call succeeds. */
static dgfem_mat3 *dgfemi_next_rotation(const dgfem_body *body) { return body->rotation + body->mesh->element_count; }

static void dgfemi_commit_rotation(dgfem_body *body) {
    memcpy(body->rotation, dgfemi_next_rotation(body), (size_t)body->mesh->element_count * sizeof *body->rotation);
}

static dgfem_step_info dgfemi_empty_info(void) {
    dgfem_step_info info;
    memset(&info, 0, sizeof info);
    info.failed_element = DGFEM_NONE;
    return info;
}

/* ---- pins and held elements ---- */

/* Adds the springs of all pins, `weight` times, to the matrix, and their force at the current displacement (step) or at
   zero displacement (static solve) to the right-hand side. */
static void dgfemi_assemble_pins(const dgfem_body *body, dgfem_real weight, dgfem_real load,
                                 const dgfem_vec3 *displacement,                                 dgfem_matrix *matrix, dgfem_vec3 *rhs) {
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_condition *pin = &body->conditions[c];
        if (pin->kind != DGFEM_CONDITION_PIN) continue;
        int e = pin->items[0], n = dgfemi_element_basis(body, e);
        dgfem_real basis[DGFEM_MAX_BASIS], *block = dgfem_matrix_block(matrix, e, e);
        dgfem_vec3 reach = dgfemi_sub(pin->vector, pin->point), *out = rhs + body->basis_start[e];
        dgfemi_basis_evaluate(body->degree[e], body->origin[e], body->scale[e], pin->point, basis);
        if (displacement) reach = dgfemi_sub(reach, dgfemi_evaluate(body, displacement, e, pin->point));
        for (int i = 0; i < n; i++) {
            out[i] = dgfemi_add_scaled(out[i], load * pin->scalar * basis[i], reach);
            for (int j = 0; j < n; j++)
                for (int a = 0; a < 3; a++)
                    block[(3 * i + a) * 3 * n + 3 * j + a] += weight * pin->scalar * basis[i] * basis[j];
        }
    }
}

/* Moves the columns of element e, whose unknowns are x, to the right-hand side of its neighbours and makes its own
   rows the identity times the size of its diagonal. A neighbour met through two faces has a zero block the second
   time. */
static void dgfemi_hold_element(const dgfem_body *body, int e, const dgfem_vec3 *x, dgfem_matrix *matrix,
                                dgfem_vec3 *rhs) {
    const dgfem_element *element = &body->mesh->elements[e];
    int n = 3 * dgfemi_element_basis(body, e);
    const dgfem_real *value = (const dgfem_real *)(const void *)x;
    for (int k = 0; k < element->face_count; k++) {
        const dgfem_face *face = &body->mesh->faces[body->mesh->element_faces[element->face_start + k]];
        int other = face->element[face->element[0] == e];
        if (other == DGFEM_NONE || face->cut) continue;
        int m = 3 * dgfemi_element_basis(body, other);
        dgfem_real *block = dgfem_matrix_block(matrix, other > e ? other : e, other > e ? e : other);
        dgfem_real *out = (dgfem_real *)(void *)(rhs + body->basis_start[other]);
        for (int i = 0; i < m; i++)
            for (int j = 0; j < n; j++) out[i] -= (other > e ? block[i * n + j] : block[j * m + i]) * value[j];
        memset(block, 0, (size_t)(m * n) * sizeof *block);
    }
    dgfem_real *diagonal = dgfem_matrix_block(matrix, e, e), size = 0;
    dgfem_real *out = (dgfem_real *)(void *)(rhs + body->basis_start[e]);
    for (int i = 0; i < n; i++) size = dgfemi_max(size, diagonal[i * n + i]);
    memset(diagonal, 0, (size_t)(n * n) * sizeof *diagonal);
    for (int i = 0; i < n; i++) {
        diagonal[i * n + i] = size;
        out[i] = size * value[i];
    }
}

/* Holds all held elements. The unknown is the displacement (dt = 0) or the velocity that reaches it after dt. */
static void dgfemi_hold_elements(const dgfem_body *body, dgfem_real dt, dgfem_matrix *matrix, dgfem_vec3 *rhs) {
    dgfem_vec3 x[DGFEM_MAX_BASIS];
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_condition *condition = &body->conditions[c];
        const dgfem_vec3 *target = condition->values;
        if (condition->kind != DGFEM_CONDITION_FIX_ELEMENTS) continue;
        for (int i = 0; i < condition->count; i++) {
            int e = condition->items[i], n = dgfemi_element_basis(body, e);
            const dgfem_vec3 *now = body->displacement + body->basis_start[e];
            for (int k = 0; k < n; k++) x[k] = dt > 0 ? dgfemi_scale(1 / dt, dgfemi_sub(target[k], now[k])) : target[k];
            dgfemi_hold_element(body, e, x, matrix, rhs);
            target += n;
        }
    }
}

/* ---- time step ---- */

/* System of one step: (M + h D + h^2 K) v+ = M v + h (F + f0 - K U), D = alpha M + beta K, contact added. */
static void dgfemi_assemble_step(dgfem_body *body, dgfem_real h, dgfem_vec3 *rhs, dgfem_step_info *info) {
    dgfem_vec3 *f0 = dgfemi_work(body, DGFEMI_WORK_F0), *ku = dgfemi_work(body, DGFEMI_WORK_Y);
    dgfem_real stiffness = h * h + h * body->desc.damping_stiffness;
    double start = dgfemi_clock(&body->hooks);
    dgfemi_rotations(body, dgfemi_next_rotation(body));
    dgfemi_assemble_stiffness(body, dgfemi_next_rotation(body), stiffness, 1, body->matrix, f0);
    dgfem_matrix_multiply(body->matrix, (const dgfem_real *)(const void *)body->displacement,
                          (dgfem_real *)(void *)ku);
    dgfemi_external_force(body, dgfemi_next_rotation(body), h, rhs);
    for (int i = 0; i < body->basis_count; i++)
        rhs[i] = dgfemi_add_scaled(dgfemi_add_scaled(rhs[i], h, f0[i]), -h / stiffness, ku[i]);
    dgfemi_add_mass_product(body, 1, body->velocity, rhs);
    dgfemi_assemble_mass(body, 1 + h * body->desc.damping_mass, body->matrix);
    dgfemi_assemble_pins(body, h * h, h, body->displacement, body->matrix, rhs);
    double middle = dgfemi_clock(&body->hooks);
    info->seconds_assemble += middle - start;
    if (body->shape_count) info->contacts = dgfemi_contacts_assemble(body->contacts, body, h, body->matrix, rhs);
    dgfemi_hold_elements(body, h, body->matrix, rhs);
    info->seconds_contact += dgfemi_clock(&body->hooks) - middle;
}

static dgfem_status dgfemi_step(dgfem_body *body, dgfem_real h, dgfem_step_info *info) {
    dgfem_vec3 *rhs = dgfemi_work(body, DGFEMI_WORK_RHS), *v = dgfemi_work(body, DGFEMI_WORK_X);
    size_t size = (size_t)body->basis_count * sizeof *v;
    dgfemi_assemble_step(body, h, rhs, info);
    memcpy(v, body->velocity, size);
    dgfem_status status = dgfemi_body_solve(body, rhs, v, info);
    if (!status) status = dgfemi_check_solution(body, v);
    if (status) return status;
    memcpy(body->velocity, v, size);
    for (int i = 0; i < body->basis_count; i++)
        body->displacement[i] = dgfemi_add_scaled(body->displacement[i], h, v[i]);
    dgfemi_commit_rotation(body);
    body->time += (double)h;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_body_step(dgfem_body *body, dgfem_real dt, dgfem_step_info *info) {
    dgfem_step_info local = dgfemi_empty_info();
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (info) *info = local;
    dgfem_status status = dgfemi_check_positive(&body->hooks, dt, "step: dt");
    if (!status) status = dgfemi_step(body, dt, &local);
    if (info) *info = local;
    return status;
}

/* ---- static solve ---- */

/* One solve of K_w U = load (F + g) + f0 with the rotations of the current displacement. Sets *change to the change of
   the displacement relative to its size. */
static dgfem_status dgfemi_static_sweep(dgfem_body *body, dgfem_real load, dgfem_real *change, dgfem_step_info *info) {
    dgfem_vec3 *f0 = dgfemi_work(body, DGFEMI_WORK_F0), *rhs = dgfemi_work(body, DGFEMI_WORK_RHS);
    dgfem_vec3 *x = dgfemi_work(body, DGFEMI_WORK_X);
    double start = dgfemi_clock(&body->hooks);
    dgfemi_rotations(body, dgfemi_next_rotation(body));
    dgfemi_assemble_stiffness(body, dgfemi_next_rotation(body), 1, load, body->matrix, f0);
    dgfemi_external_force(body, dgfemi_next_rotation(body), load, rhs);
    for (int i = 0; i < body->basis_count; i++) rhs[i] = dgfemi_add(rhs[i], f0[i]);
    dgfemi_assemble_pins(body, 1, 1, NULL, body->matrix, rhs);
    dgfemi_hold_elements(body, 0, body->matrix, rhs);
    memcpy(x, body->displacement, (size_t)body->basis_count * sizeof *x);
    info->seconds_assemble += dgfemi_clock(&body->hooks) - start;
    dgfem_status status = dgfemi_body_solve(body, rhs, x, info);
    if (!status) status = dgfemi_check_solution(body, x);
    if (status) return status;
    dgfem_real difference = 0, size = 0;
    for (int i = 0; i < body->basis_count; i++) {
        dgfem_vec3 d = dgfemi_sub(x[i], body->displacement[i]);
        difference += dgfemi_dot(d, d);
        size += dgfemi_dot(x[i], x[i]);
        body->displacement[i] = x[i];
    }
    *change = size > 0 ? dgfemi_sqrt(difference / size) : 0;
    dgfemi_commit_rotation(body);
    info->sweeps++;
    return DGFEM_OK;
}

static dgfem_status dgfemi_static_load(dgfem_body *body, const dgfem_static_desc *desc, dgfem_real load,
                                       dgfem_step_info *info) {
    for (int sweep = 0; sweep < desc->max_sweeps; sweep++) {
        dgfem_status status = dgfemi_static_sweep(body, load, &info->residual, info);
        if (status) return status;
        if (!body->desc.warp || info->residual <= desc->tolerance) return DGFEM_OK;
    }
    return dgfemi_fail(&body->hooks, DGFEM_ERROR_NOT_CONVERGED,
                       "static solve at %g of the load: the displacement still changes by %g after %d sweeps",
                       (double)load, (double)info->residual, desc->max_sweeps);
}

static dgfem_status dgfemi_solve_static(dgfem_body *body, const dgfem_static_desc *desc, dgfem_step_info *info) {
    size_t vectors = (size_t)body->basis_count * sizeof(dgfem_vec3);
    size_t rotations = (size_t)body->mesh->element_count * sizeof(dgfem_mat3);
    dgfem_status status = DGFEM_OK;
    char *saved = (char *)dgfemi_allocate(&body->hooks, vectors + rotations, 1);
    if (!saved) return dgfemi_fail_memory(&body->hooks);
    memcpy(saved, body->displacement, vectors);
    memcpy(saved + vectors, body->rotation, rotations);
    for (int step = 1; !status && step <= desc->load_steps; step++)
        status = dgfemi_static_load(body, desc, (dgfem_real)step / (dgfem_real)desc->load_steps, info);
    if (status) {
        memcpy(body->displacement, saved, vectors);
        memcpy(body->rotation, saved + vectors, rotations);
    } else {
        memset(body->velocity, 0, vectors);
    }
    dgfemi_free(&body->hooks, saved);
    return status;
}

/* Whether any condition can keep the body from drifting away. */
static int dgfemi_is_held(const dgfem_body *body) {
    for (int c = 0; c < body->condition_count; c++)
        if (body->conditions[c].kind <= DGFEM_CONDITION_PIN) return 1;
    return 0;
}

DGFEM_API dgfem_status dgfem_body_solve_static(dgfem_body *body, const dgfem_static_desc *desc, dgfem_step_info *info) {
    dgfem_step_info local = dgfemi_empty_info();
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (info) *info = local;
    dgfem_status status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (!status) status = dgfemi_check_positive(&body->hooks, desc->tolerance, "static solve: tolerance");
    if (!status && (desc->load_steps < 1 || desc->max_sweeps < 1))
        status = dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "static solve: %d load steps, %d sweeps, expected >= 1",
                             desc->load_steps, desc->max_sweeps);
    if (!status && !dgfemi_is_held(body))
        status = dgfemi_fail(&body->hooks, DGFEM_ERROR_UNCONSTRAINED, "static solve: nothing holds the body");
    if (!status) status = dgfemi_solve_static(body, desc, &local);
    if (info) *info = local;
    return status;
}

/* ==== stability.c ================================================================================================= */

/* How large the penalty must be: a bound per element that guarantees a positive definite stiffness for any rotations of
   the elements, and a search by factorization.

   The consistency terms of element K are bounded by its strain energy through
     theta_K = max over v of  sum over faces f of  w_f / (g_f p^2) int_f (sigma n) . (N^T C N)^-1 (sigma n)
                              / int_K sigma : eps,
   where N^T C N = mu I + (lambda + mu) n n^T, w_f = 1/2 between elements and 1 on held faces. eta > theta_K in all
   elements suffices: |R sigma n| = |sigma n|, so rotations change nothing. theta_K is the largest eigenvalue of a
   matrix pair on the complement of rigid motions, where both vanish. */

#define DGFEM_MAX_UNKNOWNS (3 * DGFEM_MAX_BASIS)

/* Coefficients of the traction sigma(N_j e_b) n in face monomials of degree below p: out[k] is the 3x3 matrix of
   monomial k (rows: components of the traction, columns: b). */
static void dgfemi_traction_coefficients(const dgfemi_face_frame *frame, int j, dgfem_vec3 n, dgfem_real lambda,
                                         dgfem_real mu, dgfem_mat3 *out) {
    int lower_count = dgfem_monomial_count(frame->degree - 1);
    dgfem_vec3 gradient[DGFEM_MAX_BASIS];
    memset(gradient, 0, sizeof gradient);
    for (int k = 1; k < frame->count; k++)
        for (int axis = 0; axis < 3; axis++) {
            int lower = dgfemi_derivative_index(k, axis);
            if (lower == DGFEM_NONE) continue;
            dgfem_real d = (dgfem_real)dgfemi_exponents[k][axis] * frame->jump[j][k] / frame->scale;
            if (axis == 0) gradient[lower].x += d;
            if (axis == 1) gradient[lower].y += d;
            if (axis == 2) gradient[lower].z += d;
        }
    for (int k = 0; k < lower_count; k++) out[k] = dgfemi_elastic_block(lambda, mu, n, gradient[k]);
}

/* a += s int_f T_i^T W T_j for all functions of the element, which is side 0 of the frame. */
static void dgfemi_add_traction_energy(const dgfemi_face_frame *frame, int count, dgfem_vec3 n, dgfem_real lambda,
                                       dgfem_real mu, dgfem_real s, dgfem_real *a) {
    dgfem_mat3 t[DGFEM_MAX_BASIS][10], w;
    int lower_count = dgfem_monomial_count(frame->degree - 1);
    memset(&w, 0, sizeof w);
    w.m[0][0] = w.m[1][1] = w.m[2][2] = s / mu;
    dgfemi_add_outer(&w, s / (lambda + 2 * mu) - s / mu, n, n);
    for (int j = 0; j < count; j++) dgfemi_traction_coefficients(frame, j, n, lambda, mu, t[j]);
    for (int j = 1; j < count; j++) {
        dgfem_mat3 moment[10]; /* int m_l W T_j */
        for (int l = 0; l < lower_count; l++) {
            memset(&moment[l], 0, sizeof moment[l]);
            for (int k = 0; k < lower_count; k++) {
                dgfem_real m = frame->moments[dgfemi_product_index(k, l)];
                for (int p = 0; p < 9; p++) moment[l].m[p / 3][p % 3] += m * t[j][k].m[p / 3][p % 3];
            }
            moment[l] = dgfemi_multiply3(&w, &moment[l]);
        }
        for (int i = 1; i < count; i++)
            for (int l = 0; l < lower_count; l++) {
                dgfem_mat3 transposed = dgfemi_transposed(&t[i][l]);
                dgfem_mat3 product = dgfemi_multiply3(&transposed, &moment[l]);
                dgfemi_add_block(a, 3 * count, i, j, 1, &product);
            }
    }
}

/* Both matrices of the pair; b is made definite by adding the rigid motions. */
static void dgfemi_stability_pair(const dgfem_body *body, int element, dgfem_real *a, dgfem_real *b) {
    const dgfem_forms *forms = body->forms;
    int n = forms->elements[element].count, size = 3 * n;
    dgfem_real lambda = dgfemi_lambda(&body->material[element]), mu = dgfemi_mu(&body->material[element]);
    dgfem_mat3 identity = dgfemi_identity();
    const dgfem_real *g = dgfemi_form_stiffness(forms, element);
    memset(a, 0, (size_t)(size * size) * sizeof *a);
    memset(b, 0, (size_t)(size * size) * sizeof *b);
    for (int i = 1; i < n; i++)
        for (int j = 1; j < n; j++, g += 9) {
            dgfem_mat3 k = dgfemi_element_block(g, lambda, mu, &identity, &identity);
            dgfemi_add_block(b, size, i, j, 1, &k);
        }
    dgfem_real scale = b[(3 + 0) * size + 3] + b[(3 + 1) * size + 4]; /* of the linear functions */
    for (int k = 0; k < 3; k++) {
        int p = (k + 1) % 3, q = (k + 2) % 3, u = 3 * (1 + p) + q, v = 3 * (1 + q) + p; /* turning about axis k */
        b[k * size + k] += scale;
        b[u * size + u] += scale, b[v * size + v] += scale;
        b[u * size + v] -= scale, b[v * size + u] -= scale;
    }
    for (int f = 0; f < forms->face_count; f++) {
        dgfemi_face_form form = forms->faces[f];
        if (form.element[0] != element && form.element[1] != element) continue;
        dgfemi_face_frame frame;
        int side = form.element[0] != element;
        dgfem_real weight = form.weight * body->desc.eta / form.eta_stiff;
        dgfemi_face_frame_set(body, &form, &frame);
        if (side) memmove(frame.jump, frame.jump + form.count[0], (size_t)n * sizeof frame.jump[0]);
        dgfemi_add_traction_energy(&frame, n, body->mesh->faces[form.face].normal, lambda, mu, weight, a);
    }
}

/* Largest eigenvalue of L^-1 A L^-T by power iteration: the Rayleigh quotient converges twice as fast as the vector. */
static dgfem_real dgfemi_largest_eigenvalue(const dgfem_real *a, const dgfem_real *l, int size) {
    enum { ITERATIONS = 2000 };
    dgfem_real x[DGFEM_MAX_UNKNOWNS], y[DGFEM_MAX_UNKNOWNS], value = 0;
    for (int i = 0; i < size; i++) x[i] = 1 + DGFEM_R(0.5) * dgfemi_sqrt((dgfem_real)((7 * i * i + 3) % 11));
    for (int iteration = 0; iteration < ITERATIONS; iteration++) {
        dgfem_real z[DGFEM_MAX_UNKNOWNS], norm = 0, last = value;
        for (int i = 0; i < size; i++) norm += x[i] * x[i];
        norm = dgfemi_sqrt(norm);
        if (!(norm > 0)) return 0;
        for (int i = 0; i < size; i++) z[i] = x[i] = x[i] / norm;
        for (int i = size - 1; i >= 0; i--) { /* L^-T */
            for (int k = i + 1; k < size; k++) z[i] -= l[k * size + i] * z[k];
            z[i] /= l[i * size + i];
        }
        for (int i = 0; i < size; i++) {
            y[i] = 0;
            for (int k = 0; k < size; k++) y[i] += a[i * size + k] * z[k];
        }
        value = 0;
        for (int i = 0; i < size; i++) { /* L^-1 */
            for (int k = 0; k < i; k++) y[i] -= l[i * size + k] * y[k];
            y[i] /= l[i * size + i];
            value += x[i] * y[i];
        }
        memcpy(x, y, (size_t)size * sizeof *x);
        if (iteration > 20 && dgfemi_abs(value - last) <= DGFEM_R(1e-7) * value) break;
    }
    return value;
}

DGFEM_API dgfem_status dgfem_body_stability_bound(const dgfem_body *body, int element, dgfem_real *theta) {
    if (!body || !theta) return DGFEM_ERROR_ARGUMENT;
    if (element < 0 || element >= body->mesh->element_count)
        return dgfemi_fail(&body->hooks, DGFEM_ERROR_INDEX, "element %d, expected 0..%d", element,
                           body->mesh->element_count - 1);
    int size = 3 * body->forms->elements[element].count;
    size_t square = (size_t)size * (size_t)size;
    dgfem_real *a = (dgfem_real *)dgfemi_allocate(&body->hooks, 2 * square, sizeof *a), *b = a + square;
    if (!a) return dgfemi_fail_memory(&body->hooks);
    dgfem_status status = DGFEM_OK;
    dgfemi_stability_pair(body, element, a, b);
    if (dgfemi_cholesky_dense(b, size)) *theta = dgfemi_largest_eigenvalue(a, b, size);
    else status = dgfemi_fail(&body->hooks, DGFEM_ERROR_DEGENERATE, "element %d: its strain energy is not definite", element);
    dgfemi_free(&body->hooks, a);
    return status;
}

/* ---- search ---- */

static void dgfemi_set_eta(dgfem_body *body, dgfem_real eta) {
    for (int f = 0; f < body->forms->face_count; f++) body->forms->faces[f].eta_stiff *= eta / body->desc.eta;
    body->desc.eta = eta;
}

DGFEM_API dgfem_status dgfem_body_set_eta(dgfem_body *body, dgfem_real eta) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_positive(&body->hooks, eta, "eta");
    if (!status) dgfemi_set_eta(body, eta);
    return status;
}

/* Factors the unrotated stiffness of the body, held as it is; a free body is held by a trace of its mass. */
static dgfem_status dgfemi_try_eta(dgfem_body *body, dgfem_cholesky *cholesky, dgfem_cholesky_info *info) {
    const dgfem_real trace = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-9); /* of a typical stiffness */
    dgfem_mat3 *rotation = dgfemi_next_rotation(body);
    dgfem_vec3 *rhs = dgfemi_work(body, DGFEMI_WORK_RHS);
    for (int e = 0; e < body->mesh->element_count; e++) rotation[e] = dgfemi_identity();
    dgfemi_assemble_stiffness(body, rotation, 1, 0, body->matrix, dgfemi_work(body, DGFEMI_WORK_F0));
    if (!dgfemi_is_held(body)) {
        dgfem_real r = body->scale[0];
        dgfemi_assemble_mass(body, trace * body->material[0].young / (body->material[0].density * r * r), body->matrix);
    }
    memset(rhs, 0, (size_t)body->basis_count * sizeof *rhs);
    dgfemi_assemble_pins(body, 1, 0, NULL, body->matrix, rhs);
    dgfemi_hold_elements(body, 0, body->matrix, rhs);
    return dgfem_cholesky_factor(cholesky, body->matrix, info);
}

DGFEM_API dgfem_status dgfem_body_find_eta(dgfem_body *body, dgfem_real *eta) {
    enum { MAX_DOUBLINGS = 10 };
    if (!body || !eta) return DGFEM_ERROR_ARGUMENT;
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_cholesky *cholesky = body->cholesky;
    dgfem_cholesky_info info;
    dgfem_status status = DGFEM_OK;
    dgfem_real first = body->desc.eta;
    desc.hooks = body->hooks;
    desc.hooks.log = NULL; /* a failure here is no error */
    if (!cholesky) status = dgfem_cholesky_create(body->matrix, &desc, &cholesky);
    if (status) return status;
    for (int doublings = 0;; doublings++) {
        status = dgfemi_try_eta(body, cholesky, &info);
        if (status != DGFEM_ERROR_NOT_POSITIVE_DEFINITE || doublings == MAX_DOUBLINGS) break;
        dgfemi_set_eta(body, 2 * body->desc.eta);
    }
    if (cholesky != body->cholesky) dgfem_cholesky_destroy(cholesky);
    if (status) dgfemi_set_eta(body, first);
    else *eta = body->desc.eta;
    return status;
}

/* ==== query.c ===================================================================================================== */

/* Asking a solid: fields at a point, energies, momenta, volume, internal force; setting affine fields. */

/* ---- queries ---- */

DGFEM_API dgfem_vec3 dgfem_body_displacement(const dgfem_body *body, int element, dgfem_vec3 rest) {
    DGFEM_ASSERT(body && element >= 0 && element < body->mesh->element_count);
    return dgfemi_evaluate(body, body->displacement, element, rest);
}

DGFEM_API dgfem_vec3 dgfem_body_velocity(const dgfem_body *body, int element, dgfem_vec3 rest) {
    DGFEM_ASSERT(body && element >= 0 && element < body->mesh->element_count);
    return dgfemi_evaluate(body, body->velocity, element, rest);
}

DGFEM_API dgfem_mat3 dgfem_body_gradient(const dgfem_body *body, int element, dgfem_vec3 rest) {
    dgfem_vec3 gradients[DGFEM_MAX_BASIS];
    dgfem_mat3 f = dgfemi_identity();
    DGFEM_ASSERT(body && element >= 0 && element < body->mesh->element_count);
    int start = body->basis_start[element];
    dgfemi_basis_gradients(body->degree[element], body->origin[element], body->scale[element], rest, gradients);
    for (int i = 1; i < body->basis_start[element + 1] - start; i++)
        dgfemi_add_outer(&f, 1, body->displacement[start + i], gradients[i]);
    return f;
}

/* The current rotation of one element: that of its displacement now, not of the last step's start. */
static dgfem_mat3 dgfemi_rotation_now(const dgfem_body *body, int element) {
    if (!body->desc.warp) return dgfemi_identity();
    return dgfem_rotation_of(dgfemi_mean_gradient(body, element), body->rotation[element]);
}

DGFEM_API dgfem_mat3 dgfem_body_stress(const dgfem_body *body, int element, dgfem_vec3 rest) {
    dgfem_mat3 f = dgfem_body_gradient(body, element, rest), r = dgfemi_rotation_now(body, element);
    dgfem_mat3 rt = dgfemi_transposed(&r), stretch = dgfemi_multiply3(&rt, &f), stress;
    dgfem_real lambda = dgfemi_lambda(&body->material[element]), mu = dgfemi_mu(&body->material[element]);
    dgfem_real volumetric = lambda * (dgfemi_trace(&stretch) - 3);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            stress.m[i][j] = mu * (stretch.m[i][j] + stretch.m[j][i]) + (i == j ? volumetric - 2 * mu : 0);
    stress = dgfemi_multiply3(&r, &stress);
    return dgfemi_multiply3(&stress, &rt);
}

DGFEM_API dgfem_mat3 dgfem_body_rotation(const dgfem_body *body, int element) {
    DGFEM_ASSERT(body && element >= 0 && element < body->mesh->element_count);
    return dgfemi_rotation_now(body, element);
}

DGFEM_API dgfem_vec3 dgfem_body_face_displacement(const dgfem_body *body, int face) {
    DGFEM_ASSERT(body && face >= 0 && face < body->mesh->face_count);
    const dgfem_face *f = &body->mesh->faces[face];
    dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
    int sides = f->element[1] == DGFEM_NONE ? 1 : 2;
    for (int s = 0; s < sides; s++) {
        int e = f->element[s], start = body->basis_start[e];
        dgfem_real moments[DGFEM_MAX_MOMENTS];
        dgfemi_mesh_face_moments(body->mesh, face, body->degree[e], body->origin[e], body->scale[e], moments);
        for (int i = 0; i < body->basis_start[e + 1] - start; i++)
            sum = dgfemi_add_scaled(sum, moments[i] / ((dgfem_real)sides * moments[0]), body->displacement[start + i]);
    }
    return sum;
}

/* ---- affine fields ---- */

static void dgfemi_set_affine(const dgfem_body *body, const dgfem_mat3 *linear, dgfem_vec3 translation,
                              dgfem_vec3 *coefficients) {
    for (int e = 0; e < body->mesh->element_count; e++)
        dgfemi_affine_element(body, e, linear, translation, coefficients + body->basis_start[e]);
}

DGFEM_API dgfem_status dgfem_body_set_affine(dgfem_body *body, dgfem_mat3 linear, dgfem_vec3 translation) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_affine(body, &linear, translation);
    if (status) return status;
    dgfemi_set_affine(body, &linear, translation, body->displacement);
    dgfemi_rotations(body, dgfemi_next_rotation(body));
    dgfemi_commit_rotation(body);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_body_set_affine_velocity(dgfem_body *body, dgfem_mat3 linear, dgfem_vec3 translation) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_affine(body, &linear, translation);
    if (!status) dgfemi_set_affine(body, &linear, translation, body->velocity);
    return status;
}

/* ---- conserved quantities ---- */

/* int_element N_i position for one element: rest position is origin + scale * (linear monomials). */
static dgfem_vec3 dgfemi_position_coefficient(const dgfem_body *body, int element, int i) {
    dgfem_vec3 x = body->displacement[body->basis_start[element] + i];
    if (i == 0) x = dgfemi_add(x, body->origin[element]);
    if (i == 1) x.x += body->scale[element];
    if (i == 2) x.y += body->scale[element];
    if (i == 3) x.z += body->scale[element];
    return x;
}

DGFEM_API dgfem_real dgfem_body_mass(const dgfem_body *body) {
    dgfem_real mass = 0;
    for (int e = 0; e < body->mesh->element_count; e++)
        mass += body->material[e].density * body->mesh->elements[e].volume;
    return mass;
}

DGFEM_API dgfem_status dgfem_body_momentum(const dgfem_body *body, dgfem_vec3 *linear, dgfem_vec3 *angular) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_vec3 p = dgfemi_vec3(0, 0, 0), l = p;
    for (int e = 0; e < body->mesh->element_count; e++) {
        const dgfemi_element_form *form = &body->forms->elements[e];
        const dgfem_real *mass = dgfemi_form_mass(body->forms, e);
        const dgfem_vec3 *v = body->velocity + body->basis_start[e];
        dgfem_real density = body->material[e].density;
        for (int i = 0; i < form->count; i++) {
            dgfem_vec3 x = dgfemi_position_coefficient(body, e, i);
            p = dgfemi_add_scaled(p, density * mass[i], v[i]);
            for (int j = 0; j < form->count; j++)
                l = dgfemi_add_scaled(l, density * mass[i * form->count + j], dgfemi_cross(x, v[j]));
        }
    }
    if (linear) *linear = p;
    if (angular) *angular = l;
    return DGFEM_OK;
}

static dgfem_real dgfemi_kinetic_energy(const dgfem_body *body) {
    dgfem_real energy = 0;
    for (int e = 0; e < body->mesh->element_count; e++) {
        const dgfemi_element_form *form = &body->forms->elements[e];
        const dgfem_real *mass = dgfemi_form_mass(body->forms, e);
        const dgfem_vec3 *v = body->velocity + body->basis_start[e];
        for (int i = 0; i < form->count; i++)
            for (int j = 0; j < form->count; j++)
                energy += body->material[e].density * mass[i * form->count + j] * dgfemi_dot(v[i], v[j]) / 2;
    }
    return energy;
}

static dgfem_real dgfemi_gravity_energy(const dgfem_body *body) {
    dgfem_real energy = 0;
    for (int e = 0; e < body->mesh->element_count; e++) {
        const dgfemi_element_form *form = &body->forms->elements[e];
        const dgfem_real *load = dgfemi_form_load(body->forms, e);
        for (int i = 0; i < form->count; i++)
            energy -= body->material[e].density * load[i] *
                      dgfemi_dot(body->desc.gravity, dgfemi_position_coefficient(body, e, i));
    }
    return energy;
}

/* Rotations of the current displacement in temporary memory; NULL when there is none. */
static dgfem_mat3 *dgfemi_rotations_now(const dgfem_body *body) {
    dgfem_mat3 *rotation =
        (dgfem_mat3 *)dgfemi_allocate(&body->hooks, (size_t)body->mesh->element_count, sizeof *rotation);
    if (rotation) dgfemi_rotations(body, rotation);
    return rotation;
}

DGFEM_API dgfem_status dgfem_body_energy(const dgfem_body *body, dgfem_energy *out) {
    if (!body || !out) return DGFEM_ERROR_ARGUMENT;
    dgfem_mat3 *rotation = dgfemi_rotations_now(body);
    if (!rotation) return dgfemi_fail_memory(&body->hooks);
    out->kinetic = dgfemi_kinetic_energy(body);
    out->elastic = dgfemi_elastic_energy(body, rotation, NULL);
    out->gravity = dgfemi_gravity_energy(body);
    dgfemi_free(&body->hooks, rotation);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_body_internal_force(const dgfem_body *body, dgfem_vec3 *out) {
    if (!body || !out) return DGFEM_ERROR_ARGUMENT;
    dgfem_mat3 *rotation = dgfemi_rotations_now(body);
    if (!rotation) return dgfemi_fail_memory(&body->hooks);
    memset(out, 0, (size_t)body->basis_count * sizeof *out);
    (void)dgfemi_elastic_energy(body, rotation, out);
    dgfemi_free(&body->hooks, rotation);
    return DGFEM_OK;
}

/* Deformed volume: for linear polynomials det F is constant in the element; for higher degrees its value at the
   centroid stands for the mean. */
DGFEM_API dgfem_real dgfem_body_volume(const dgfem_body *body) {
    dgfem_real volume = 0;
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfem_mat3 f = dgfem_body_gradient(body, e, body->origin[e]);
        volume += dgfemi_determinant(&f) * body->mesh->elements[e].volume;
    }
    return volume;
}

/* ==== degree.c ==================================================================================================== */

/* Changing the polynomial degree of elements while the body lives: coefficients are kept exactly when the degree is
   raised and L2-projected when it is lowered; integrals of what did not change are kept. */

/* u_new of one element. The new basis is the first part of the old one or the other way round, so raising adds zeros
   and lowering solves M_new u_new = (first rows of M_old) u_old, with M_new the first rows and columns of M_old. */
static void dgfemi_project_degree(const dgfem_real *mass, int n_old, int n_new, const dgfem_vec3 *old,
                                  dgfem_vec3 *out) {
    dgfem_real m[DGFEM_MAX_BASIS * DGFEM_MAX_BASIS];
    memset(out, 0, (size_t)n_new * sizeof *out);
    if (n_new >= n_old) {
        memcpy(out, old, (size_t)n_old * sizeof *out);
        return;
    }
    for (int i = 0; i < n_new; i++) {
        memcpy(m + i * n_new, mass + i * n_old, (size_t)n_new * sizeof *m);
        for (int j = 0; j < n_old; j++) out[i] = dgfemi_add_scaled(out[i], mass[i * n_old + j], old[j]);
    }
    int ok = dgfemi_cholesky_dense(m, n_new); /* factored as part of the old mass matrix before */
    DGFEM_ASSERT(ok);
    (void)ok;
    dgfemi_cholesky_dense_solve(m, n_new, (dgfem_real *)(void *)out, 3);
}

/* The new forms of a face: copied where both sides kept their degree, else integrated, with the ghost of a held face
   carried over. 0 when out of memory. */
static int dgfemi_renew_face_form(const dgfem_body *old, const dgfem_body *body, const dgfemi_face_form *from,
                                  dgfemi_face_form *to) {
    int a = from->element[0], b = from->element[1];
    *to = *from;
    if (old->degree[a] == body->degree[a] && (b == DGFEM_NONE || old->degree[b] == body->degree[b])) {
        size_t size = dgfemi_face_form_size(from);
        if (!dgfemi_forms_take(body->forms, &body->hooks, size, &to->data)) return 0;
        memcpy(body->forms->data + to->data, old->forms->data + from->data, size * sizeof(dgfem_real));
        return 1;
    }
    if (!dgfemi_forms_set_face(body, body->forms, to)) return 0;
    if (b == DGFEM_NONE) {
        int kept = from->count[1] < to->count[1] ? from->count[1] : to->count[1];
        memcpy(dgfemi_form_ghost(body->forms, to), dgfemi_form_ghost(old->forms, from),
               (size_t)kept * sizeof(dgfem_vec3));
    }
    return 1;
}

static int dgfemi_renew_forms(const dgfem_body *old, dgfem_body *body) {
    const dgfem_hooks *hooks = &body->hooks;
    dgfem_forms *forms = (dgfem_forms *)dgfemi_allocate_zero(hooks, 1, sizeof *forms);
    body->forms = forms;
    if (!forms) return 0;
    int elements = body->mesh->element_count, faces = old->forms->face_count;
    forms->elements = (dgfemi_element_form *)dgfemi_allocate(hooks, (size_t)elements, sizeof *forms->elements);
    forms->faces = (dgfemi_face_form *)dgfemi_allocate(hooks, (size_t)faces, sizeof *forms->faces);
    if (!forms->elements || !forms->faces) return 0;
    forms->face_capacity = faces;
    for (int e = 0; e < elements; e++) {
        if (old->degree[e] != body->degree[e]) {
            if (!dgfemi_forms_set_element(body, forms, e)) return 0;
            continue;
        }
        size_t size = dgfemi_element_form_size(old->forms->elements[e].count);
        forms->elements[e] = old->forms->elements[e];
        if (!dgfemi_forms_take(forms, hooks, size, &forms->elements[e].data)) return 0;
        memcpy(forms->data + forms->elements[e].data, old->forms->data + old->forms->elements[e].data,
               size * sizeof(dgfem_real));
    }
    for (; forms->face_count < faces; forms->face_count++)
        if (!dgfemi_renew_face_form(old, body, &old->forms->faces[forms->face_count], &forms->faces[forms->face_count]))
            return 0;
    return 1;
}

static void dgfemi_project_state(const dgfem_body *old, dgfem_body *body) {
    for (int e = 0; e < body->mesh->element_count; e++) {
        const dgfem_real *mass = dgfemi_form_mass(old->forms, e);
        int from = old->basis_start[e], to = body->basis_start[e];
        int n_old = dgfemi_element_basis(old, e), n_new = dgfemi_element_basis(body, e);
        dgfemi_project_degree(mass, n_old, n_new, old->displacement + from, body->displacement + to);
        dgfemi_project_degree(mass, n_old, n_new, old->velocity + from, body->velocity + to);
    }
}

/* New values of held elements, in the order of the conditions; NULL entries for the other kinds. 0 when out of
   memory. */
static int dgfemi_renew_values(const dgfem_body *old, const dgfem_body *body, dgfem_vec3 **values) {
    for (int c = 0; c < old->condition_count; c++) {
        const dgfem_condition *condition = &old->conditions[c];
        size_t count = 0;
        if (condition->kind != DGFEM_CONDITION_FIX_ELEMENTS) continue;
        for (int i = 0; i < condition->count; i++) count += (size_t)dgfemi_element_basis(body, condition->items[i]);
        values[c] = (dgfem_vec3 *)dgfemi_allocate(&body->hooks, count, sizeof(dgfem_vec3));
        if (!values[c]) return 0;
        const dgfem_vec3 *from = condition->values;
        dgfem_vec3 *to = values[c];
        for (int i = 0; i < condition->count; i++) {
            int e = condition->items[i], n_old = dgfemi_element_basis(old, e), n_new = dgfemi_element_basis(body, e);
            dgfemi_project_degree(dgfemi_form_mass(old->forms, e), n_old, n_new, from, to);
            from += n_old, to += n_new;
        }
    }
    return 1;
}

/* Everything of the body that depends on degrees, made anew in `body`, a copy of `old` in which those members are
   NULL. */
static dgfem_status dgfemi_renew_body(const dgfem_body *old, dgfem_body *body, const int *degrees,
                                      dgfem_vec3 **values) {
    size_t n = (size_t)body->mesh->element_count;
    body->degree = (int *)dgfemi_duplicate(&body->hooks, degrees, n, sizeof(int));
    body->basis_start = (int *)dgfemi_allocate(&body->hooks, n + 1, sizeof(int));
    if (!body->degree || !body->basis_start) return DGFEM_ERROR_MEMORY;
    body->basis_start[0] = 0;
    for (size_t e = 0; e < n; e++) body->basis_start[e + 1] = body->basis_start[e] + dgfem_monomial_count(degrees[e]);
    body->basis_count = body->basis_start[n];
    if (!dgfemi_body_allocate_state(body) || !dgfemi_renew_forms(old, body)) return DGFEM_ERROR_MEMORY;
    dgfemi_project_state(old, body);
    if (!dgfemi_renew_values(old, body, values)) return DGFEM_ERROR_MEMORY;
    dgfem_status status = dgfemi_body_create_solver(body);
    if (!status && old->contacts) status = dgfemi_contacts_renew(old->contacts, body, &body->contacts);
    return status;
}

/* Frees the members that dgfemi_renew_body makes. */
static void dgfemi_free_renewed(dgfem_body *body) {
    dgfem_hooks hooks = body->hooks;
    dgfemi_free(&hooks, body->degree);
    dgfemi_free(&hooks, body->basis_start);
    dgfemi_free(&hooks, body->displacement);
    dgfemi_free(&hooks, body->velocity);
    dgfemi_free(&hooks, body->force);
    dgfemi_free(&hooks, body->work);
    dgfemi_forms_destroy(body->forms, &hooks);
    dgfemi_contacts_destroy(body->contacts);
    dgfem_matrix_destroy(body->matrix);
    dgfem_cholesky_destroy(body->cholesky);
}

static dgfem_status dgfemi_set_degrees(dgfem_body *body, const int *degrees) {
    dgfemi_arena arena = dgfemi_arena_make(&body->hooks);
    dgfem_body next = *body, last = *body;
    dgfem_vec3 **values =
        (dgfem_vec3 **)dgfemi_arena_allocate_zero(&arena, (size_t)body->condition_count, sizeof *values);
    if (!values) return dgfemi_fail_memory(&body->hooks);
    next.degree = next.basis_start = NULL;
    next.displacement = next.velocity = next.force = NULL;
    next.work = NULL, next.forms = NULL, next.contacts = NULL, next.matrix = NULL, next.cholesky = NULL;
    next.revision++; /* contact points are embedded in the new revision */
    dgfem_status status = dgfemi_renew_body(body, &next, degrees, values);
    if (status) {
        for (int c = 0; c < body->condition_count; c++) dgfemi_free(&body->hooks, values[c]);
        dgfemi_free_renewed(&next);
        dgfemi_arena_free(&arena);
        return status == DGFEM_ERROR_MEMORY ? dgfemi_fail_memory(&body->hooks) : status;
    }
    *body = next;
    for (int c = 0; c < body->condition_count; c++) {
        if (!values[c]) continue;
        dgfemi_free(&body->hooks, body->conditions[c].values);
        body->conditions[c].values = values[c];
    }
    dgfemi_update_force(body);
    dgfemi_free_renewed(&last);
    dgfemi_arena_free(&arena);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_body_set_degrees(dgfem_body *body, const int *degrees) {
    if (!body || !degrees) return DGFEM_ERROR_ARGUMENT;
    for (int e = 0; e < body->mesh->element_count; e++)
        if (degrees[e] < 1 || degrees[e] > DGFEM_MAX_DEGREE)
            return dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "element %d: degree %d, expected 1..%d", e,
                               degrees[e], DGFEM_MAX_DEGREE);
    return dgfemi_set_degrees(body, degrees);
}

DGFEM_API dgfem_status dgfem_body_set_degree(dgfem_body *body, int element, int degree) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_elements(body, &element, 1);
    if (status) return status;
    int *degrees = (int *)dgfemi_duplicate(&body->hooks, body->degree, (size_t)body->mesh->element_count, sizeof(int));
    if (!degrees) return dgfemi_fail_memory(&body->hooks);
    degrees[element] = degree;
    status = dgfem_body_set_degrees(body, degrees);
    dgfemi_free(&body->hooks, degrees);
    return status;
}

/* ==== skin.c ====================================================================================================== */

/* A render mesh that follows a body: positions by embedding, normals from its own triangles. */

DGFEM_API dgfem_skin_desc dgfem_default_skin_desc(void) {
    dgfem_skin_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.vertices.type = DGFEM_NUMBER_OF_REAL;
    return desc;
}

/* ---- update ---- */

#define DGFEM_SKIN_GRAIN 256

static void dgfemi_skin_positions_range(void *context, int first, int last) {
    dgfem_skin *skin = (dgfem_skin *)context;
    for (int v = first; v < last; v++) skin->positions[v] = dgfemi_add(skin->embedding->points[v], skin->positions[v]);
}

/* The vertex's share of a triangle: its unit normal times the angle between the two edges that meet in the vertex. */
static dgfem_vec3 dgfemi_corner_normal(dgfem_vec3 at, dgfem_vec3 next, dgfem_vec3 previous) {
    dgfem_vec3 a = dgfemi_sub(next, at), b = dgfemi_sub(previous, at), n = dgfemi_cross(a, b);
    dgfem_real length = dgfemi_norm(n);
    if (!(length > 0)) return dgfemi_vec3(0, 0, 0);
    return dgfemi_scale((dgfem_real)atan2((double)length, (double)dgfemi_dot(a, b)) / length, n);
}

static void dgfemi_skin_normals_range(void *context, int first, int last) {
    dgfem_skin *skin = (dgfem_skin *)context;
    for (int v = first; v < last; v++) {
        dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
        for (int i = skin->corner_start[v]; i < skin->corner_start[v + 1]; i++) {
            int corner = skin->corners[i], triangle = corner - corner % 3;
            int next = skin->triangles[triangle + (corner + 1) % 3],
                previous = skin->triangles[triangle + (corner + 2) % 3];
            sum = dgfemi_add(
                sum, dgfemi_corner_normal(skin->positions[v], skin->positions[next], skin->positions[previous]));
        }
        skin->normals[v] = dgfemi_normalized(sum);
    }
}

static void dgfemi_skin_update(dgfem_skin *skin, const dgfem_body *body) {
    dgfemi_embedding_samples(skin->embedding, body, body->displacement, skin->sample_displacement);
    dgfemi_embedding_points(skin->embedding, skin->sample_displacement, skin->positions);
    dgfemi_parallel_for(&skin->hooks, skin->vertex_count, DGFEM_SKIN_GRAIN, dgfemi_skin_positions_range, skin);
    if (skin->normals)
        dgfemi_parallel_for(&skin->hooks, skin->vertex_count, DGFEM_SKIN_GRAIN, dgfemi_skin_normals_range, skin);
}

DGFEM_API dgfem_status dgfem_skin_update(dgfem_skin *skin, const dgfem_body *body) {
    if (!skin) return DGFEM_ERROR_ARGUMENT;
    if (!body) return dgfemi_fail(&skin->hooks, DGFEM_ERROR_ARGUMENT, "skin: no body");
    if (skin->embedding->revision != body->revision)
        return dgfemi_fail(&skin->hooks, DGFEM_ERROR_REVISION, "skin: made for revision %d of the body, which is at %d",
                           skin->embedding->revision, body->revision);
    dgfemi_skin_update(skin, body);
    return DGFEM_OK;
}

/* ---- creation ---- */

static dgfem_status dgfemi_check_skin_desc(const dgfem_skin_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    const dgfem_points_in *vertices = &desc->vertices;
    dgfem_status status =
        dgfemi_check_points(hooks, vertices->data, vertices->type, vertices->stride, vertices->count, "skin vertices");
    if (status != DGFEM_OK) return status;
    if (desc->triangle_count < 0 || desc->triangle_count > INT_MAX / 3)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "skin: %d triangles", desc->triangle_count);
    if (!desc->triangles && desc->triangle_count > 0)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "skin: no data for %d triangles", desc->triangle_count);
    for (int i = 0; i < 3 * desc->triangle_count; i++)
        if (desc->triangles[i] < 0 || desc->triangles[i] >= vertices->count)
            return dgfemi_fail(hooks, DGFEM_ERROR_INDEX, "skin triangle %d names vertex %d of %d", i / 3,
                               desc->triangles[i], vertices->count);
    return DGFEM_OK;
}

/* Lists the corners (3 * triangle + 0, 1, 2) of each vertex: normals then gather, each vertex on its own. */
static int dgfemi_skin_make_corners(dgfem_skin *skin) {
    int corners = 3 * skin->triangle_count, total = 0;
    skin->corner_start = (int *)dgfemi_allocate_zero(&skin->hooks, (size_t)skin->vertex_count + 1, sizeof(int));
    skin->corners = (int *)dgfemi_allocate(&skin->hooks, (size_t)corners, sizeof(int));
    if (!skin->corner_start || !skin->corners) return 0;
    for (int i = 0; i < corners; i++) skin->corner_start[skin->triangles[i]]++;
    for (int v = 0; v <= skin->vertex_count; v++) { /* the end of each list, from where it is filled backwards */
        total += skin->corner_start[v];
        skin->corner_start[v] = total;
    }
    for (int i = corners - 1; i >= 0; i--) skin->corners[--skin->corner_start[skin->triangles[i]]] = i;
    return 1;
}

/* 1 on success, 0 when out of memory. */
static int dgfemi_skin_allocate(dgfem_skin *skin, const dgfem_skin_desc *desc) {
    const dgfem_hooks *hooks = &skin->hooks;
    skin->vertex_count = desc->vertices.count;
    skin->positions = (dgfem_vec3 *)dgfemi_allocate(hooks, (size_t)skin->vertex_count, sizeof(dgfem_vec3));
    if (!skin->positions) return 0;
    if (!desc->triangles) return 1;
    skin->triangle_count = desc->triangle_count;
    skin->normals = (dgfem_vec3 *)dgfemi_allocate(hooks, (size_t)skin->vertex_count, sizeof(dgfem_vec3));
    skin->triangles = (int *)dgfemi_duplicate(hooks, desc->triangles, 3 * (size_t)desc->triangle_count, sizeof(int));
    return skin->normals && skin->triangles && dgfemi_skin_make_corners(skin);
}

DGFEM_API void dgfem_skin_destroy(dgfem_skin *skin) {
    dgfem_hooks hooks;
    if (!skin) return;
    hooks = skin->hooks;
    dgfem_embedding_destroy(skin->embedding);
    dgfemi_free(&hooks, skin->positions);
    dgfemi_free(&hooks, skin->normals);
    dgfemi_free(&hooks, skin->triangles);
    dgfemi_free(&hooks, skin->corner_start);
    dgfemi_free(&hooks, skin->corners);
    dgfemi_free(&hooks, skin->sample_displacement);
    dgfemi_free(&hooks, skin);
}

static dgfem_status dgfemi_skin_create(const dgfem_body *body, const dgfem_skin_desc *desc, dgfem_skin **out) {
    const dgfem_hooks *hooks = &desc->hooks;
    dgfem_skin *skin = (dgfem_skin *)dgfemi_allocate_zero(hooks, 1, sizeof *skin);
    dgfem_status status = DGFEM_OK;
    if (!skin) return dgfemi_fail_memory(hooks);
    skin->hooks = *hooks;
    if (!dgfemi_skin_allocate(skin, desc)) status = dgfemi_fail_memory(hooks);
    if (status == DGFEM_OK) status = dgfemi_embedding_create(body, &desc->vertices, hooks, &skin->embedding);
    if (status == DGFEM_OK) {
        skin->sample_displacement =
            (dgfem_vec3 *)dgfemi_allocate(hooks, (size_t)skin->embedding->sample_count, sizeof(dgfem_vec3));
        if (!skin->sample_displacement) status = dgfemi_fail_memory(hooks);
    }
    if (status != DGFEM_OK) {
        dgfem_skin_destroy(skin);
        return status;
    }
    dgfemi_skin_update(skin, body);
    *out = skin;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_skin_create(const dgfem_body *body, const dgfem_skin_desc *desc, dgfem_skin **out) {
    dgfem_status status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (out) *out = NULL;
    if (status != DGFEM_OK) return status;
    if (!body || !out) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "skin: no %s", body ? "result" : "body");
    status = dgfemi_check_skin_desc(desc);
    return status == DGFEM_OK ? dgfemi_skin_create(body, desc, out) : status;
}

/* ---- results ---- */

static dgfem_status dgfemi_skin_write(const dgfem_skin *skin, const dgfem_vec3 *values, const dgfem_points_out *out,
                                      const char *what) {
    dgfem_status status = dgfemi_check_points(&skin->hooks, out->data, out->type, out->stride, out->count, what);
    if (status != DGFEM_OK) return status;
    if (out->count < skin->vertex_count)
        return dgfemi_fail(&skin->hooks, DGFEM_ERROR_ARGUMENT, "%s: room for %d of %d", what, out->count,
                           skin->vertex_count);
    for (int v = 0; v < skin->vertex_count; v++) dgfemi_point_write(out, v, values[v]);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_skin_positions(const dgfem_skin *skin, dgfem_points_out out) {
    if (!skin) return DGFEM_ERROR_ARGUMENT;
    return dgfemi_skin_write(skin, skin->positions, &out, "skin positions");
}

DGFEM_API dgfem_status dgfem_skin_normals(const dgfem_skin *skin, dgfem_points_out out) {
    if (!skin) return DGFEM_ERROR_ARGUMENT;
    if (!skin->normals) return dgfemi_fail(&skin->hooks, DGFEM_ERROR_ARGUMENT, "skin normals: it has no triangles");
    return dgfemi_skin_write(skin, skin->normals, &out, "skin normals");
}

#endif /* DGFEM_IMPLEMENTATION */

/* Copyright (c) the dgfem authors

   Permission is hereby granted, free of charge, to any person obtaining a copy of this software and associated
   documentation files (the "Software"), to deal in the Software without restriction, including without limitation the
   rights to use, copy, modify, merge, publish, distribute, sublicense, and/or sell copies of the Software, and to permit
   persons to whom the Software is furnished to do so, subject to the following conditions:

   The above copyright notice and this permission notice shall be included in all copies or substantial portions of the
   Software.

   THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED, INCLUDING BUT NOT LIMITED TO THE
   WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR
   COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR
   OTHERWISE, ARISING FROM, OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE. */
