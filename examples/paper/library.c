/* The library, compiled once for all programs of this directory. */
#define DGFEM_REAL double
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"
