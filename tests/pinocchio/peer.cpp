// Times of pinocchio's algorithms, for compare.py: the same postures and the same batches as `armplane bench model`.
//
// Prints one line per arm and algorithm: NAME ALGORITHM NANOSECONDS (median of the samples).

#include <pinocchio/algorithm/compute-all-terms.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/parsers/urdf.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

namespace {

constexpr int samples = 5000;
constexpr int batch = 100;

/// Keeps the compiler from leaving out what nobody reads.
template <class T> void keep(const T &value) { asm volatile("" : : "g"(&value) : "memory"); }

template <class Work> double median_ns(int joints, Work work) {
  using clock = std::chrono::steady_clock;
  std::vector<double> times;
  Eigen::VectorXd q(joints), qdot(joints);
  for (int sample = 0; sample < samples; ++sample) {
    const double angle = 0.01 * sample;
    for (int joint = 0; joint < joints; ++joint) {
      q[joint] = 0.3 + std::sin(angle + joint);
      qdot[joint] = std::cos(angle * joint);
    }
    const auto began = clock::now();
    for (int i = 0; i < batch; ++i) {
      keep(q);
      keep(qdot);
      work(q, qdot);
    }
    times.push_back(std::chrono::duration<double, std::nano>(clock::now() - began).count() / batch);
  }
  std::nth_element(times.begin(), times.begin() + samples / 2, times.end());
  return times[samples / 2];
}

} // namespace

int main(int count, char **arguments) {
  for (int i = 1; i + 1 < count; i += 2) {
    const std::string name = arguments[i];
    pinocchio::Model model;
    pinocchio::urdf::buildModel(arguments[i + 1], model);
    pinocchio::Data data(model);
    if (model.nq != model.nv) {
      std::fprintf(stderr, "%s has a joint whose position and velocity differ in size\n", name.c_str());
      return 1;
    }
    const auto print = [&](const char *algorithm, double ns) { std::printf("%s %s %.1f\n", name.c_str(), algorithm, ns); };
    print("computeAllTerms", median_ns(model.nv, [&](const auto &q, const auto &qdot) {
            pinocchio::computeAllTerms(model, data, q, qdot);
            keep(data.M);
          }));
    print("crba", median_ns(model.nv, [&](const auto &q, const auto &) {
            pinocchio::crba(model, data, q);
            keep(data.M);
          }));
    print("rnea", median_ns(model.nv, [&](const auto &q, const auto &qdot) {
            pinocchio::rnea(model, data, q, qdot, qdot);
            keep(data.tau);
          }));
  }
}
