// Times of pinocchio's algorithms on the model in argv[1], at the states of terms.rs: one line per algorithm, its name and its median in ns.
// The wheel's headers need the four definitions that compare.py passes; multibody.hpp and serialization.hpp avoid the URDF parser, which they do not have.
#include "pinocchio/multibody.hpp"
#include "pinocchio/serialization.hpp"

#include "pinocchio/algorithm/compute-all-terms.hpp"
#include "pinocchio/algorithm/crba.hpp"
#include "pinocchio/algorithm/rnea.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <vector>

namespace {

constexpr int kSamples = 5000;
constexpr int kBatch = 100;

double now_ns() {
  timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return 1e9 * static_cast<double>(now.tv_sec) + static_cast<double>(now.tv_nsec);
}

template <class Work>
void row(const char* name, const pinocchio::Model& model, Work work) {
  Eigen::VectorXd q(model.nq), v(model.nv);
  std::vector<double> times;
  for (int sample = 0; sample < kSamples; ++sample) {
    const double angle = 0.01 * sample;
    for (int joint = 0; joint < model.nv; ++joint) {
      q[joint] = 0.3 + std::sin(angle + joint);
      v[joint] = std::cos(angle * joint);
    }
    const double began = now_ns();
    for (int i = 0; i < kBatch; ++i) {
      work(q, v);
      asm volatile("" ::: "memory");  // The results count as read, and the state as new.
    }
    times.push_back((now_ns() - began) / kBatch);
  }
  std::nth_element(times.begin(), times.begin() + kSamples / 2, times.end());
  std::printf("%s %.1f\n", name, times[kSamples / 2]);
}

}  // namespace

int main(int, char** argv) {
  pinocchio::Model model;
  model.loadFromText(argv[1]);
  pinocchio::Data data(model);
  row("computeAllTerms", model, [&](const auto& q, const auto& v) { pinocchio::computeAllTerms(model, data, q, v); });
  row("crba", model, [&](const auto& q, const auto&) { pinocchio::crba(model, data, q, pinocchio::Convention::WORLD); });
  row("crba, LOCAL", model, [&](const auto& q, const auto&) { pinocchio::crba(model, data, q, pinocchio::Convention::LOCAL); });
  row("rnea", model, [&](const auto& q, const auto& v) { pinocchio::rnea(model, data, q, v, v); });
}
