/* Eigen's SimplicialLLT behind a C function. */
#include <Eigen/OrderingMethods>
#include <Eigen/SparseCholesky>

extern "C" int eigen_llt(int size, const int *start, const int *row, const double *value, const double *b, double *x,
                         double (*clock)(void *user), double *seconds) {
    using matrix = Eigen::SparseMatrix<double>;
    Eigen::Map<const matrix> a(size, size, start[size], start, row, value);
    Eigen::SimplicialLLT<matrix, Eigen::Upper, Eigen::AMDOrdering<int>> llt;
    const double begin = clock(nullptr);
    llt.analyzePattern(a);
    const double analysed = clock(nullptr);
    llt.factorize(a);
    const double factored = clock(nullptr);
    if (llt.info() != Eigen::Success) return 0;
    Eigen::Map<Eigen::VectorXd>(x, size) = llt.solve(Eigen::Map<const Eigen::VectorXd>(b, size));
    seconds[0] = analysed - begin;
    seconds[1] = factored - analysed;
    seconds[2] = clock(nullptr) - factored;
    return 1;
}
