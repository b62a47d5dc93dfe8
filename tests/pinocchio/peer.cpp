// Times of pinocchio's algorithms, for compare.py: the same postures and the same batches as `armplane bench model`.
//
// Reads arms from standard input, as compare.py gets them from pinocchio's own URDF parser: NAME JOINTS, then of each joint its type (RX, RY, RZ), its
// placement in the joint before it (position, rotation by rows) and its body's mass, centre of mass and inertia about it (by rows).
// Prints one line per arm and algorithm: NAME ALGORITHM NANOSECONDS (median of the samples).

#include <pinocchio/algorithm/compute-all-terms.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/rnea.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <iostream>
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

template <int Rows, int Columns> Eigen::Matrix<double, Rows, Columns> read() {
  Eigen::Matrix<double, Rows, Columns> m;
  for (int row = 0; row < Rows; ++row)
    for (int column = 0; column < Columns; ++column) std::cin >> m(row, column);
  return m;
}

pinocchio::Model read_model(int joints) {
  using namespace pinocchio;
  Model model;
  JointIndex last = 0;
  for (int joint = 0; joint < joints; ++joint) {
    std::string type;
    std::cin >> type;
    const Eigen::Vector3d p = read<3, 1>();
    const SE3 placement(read<3, 3>(), p);
    const std::string name = "joint" + std::to_string(joint);
    if (type == "RX") last = model.addJoint(last, JointModelRX(), placement, name);
    if (type == "RY") last = model.addJoint(last, JointModelRY(), placement, name);
    if (type == "RZ") last = model.addJoint(last, JointModelRZ(), placement, name);
    double mass;
    std::cin >> mass;
    const Eigen::Vector3d centre = read<3, 1>();
    const Eigen::Matrix3d inertia = read<3, 3>();
    model.appendBodyToJoint(last, Inertia(mass, centre, inertia), SE3::Identity());
  }
  return model;
}

} // namespace

int main() {
  std::string name;
  for (int joints; std::cin >> name >> joints;) {
    const pinocchio::Model model = read_model(joints);
    if (!std::cin || model.nv != joints) {
      std::fprintf(stderr, "%s cannot be read\n", name.c_str());
      return 1;
    }
    pinocchio::Data data(model);
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
