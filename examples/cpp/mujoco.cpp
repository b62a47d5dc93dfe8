// An arm in MuJoCo goes through its wrist lock along a line, under the law of libarmplane. Arguments: its MJCF, arm.xml, and the URDF made of it, arm.urdf.
#include <libarmplane.h>
#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

using Arm = std::unique_ptr<armplane_arm, decltype(&armplane_arm_destroy)>;
using Law = std::unique_ptr<armplane_law, decltype(&armplane_law_destroy)>;
using Model = std::unique_ptr<mjModel, decltype(&mj_deleteModel)>;
using Data = std::unique_ptr<mjData, decltype(&mj_deleteData)>;

Arm read_arm(const char* path) {
    char why[512];
    armplane_arm* arm = nullptr;
    if (armplane_arm_create_from_file(ARMPLANE_ABI_VERSION, path, "tip", nullptr, &arm, why, sizeof why)) throw std::runtime_error(why);
    return {arm, armplane_arm_destroy};
}

Law make_law(const Arm& arm, double dt) {
    char why[512];
    armplane_law* law = nullptr;
    if (armplane_law_create(ARMPLANE_ABI_VERSION, arm.get(), dt, nullptr, nullptr, &law, why, sizeof why)) throw std::runtime_error(why);
    return {law, armplane_law_destroy};
}

int run(const char* path, const char* urdf) {
    const Arm arm = read_arm(urdf);
    char why[1000] = "";
    const Model model(mj_loadXML(path, nullptr, why, sizeof why), mj_deleteModel);
    if (!model) throw std::runtime_error(why);
    const Data data(mj_makeData(model.get()), mj_deleteData);
    const std::size_t n = armplane_arm_joint_count(arm.get());
    const double dt = model->opt.timestep;
    const Law law = make_law(arm, dt);

    const std::vector<double> start = {0.2, -0.6, 1.1, 0.0, -0.25, 0.0};
    std::copy(start.begin(), start.end(), data->qpos);
    mj_forward(model.get(), data.get());
    const int tip = mj_name2id(model.get(), mjOBJ_SITE, "tip");
    double pose[7];  // x y z qw qx qy qz
    std::copy_n(data->site_xpos + 3 * tip, 3, pose);
    mju_mat2Quat(pose + 3, data->site_xmat + 9 * tip);

    const double speed[6] = {0.0, 0.0, 0.07, 0.0, 0.0, 0.0}, rest[6] = {};  // [linear; angular], upwards
    const int moving = static_cast<int>(3.0 / dt), ticks = static_cast<int>(4.0 / dt);
    double off = 0.0;
    int crossings = 0, engaged = 0;
    double bend = start[4];
    for (int tick = 0; tick < ticks; ++tick) {
        const double* twist = tick < moving ? speed : rest;
        if (armplane_law_step(law.get(), data->qpos, data->qvel, pose, twist, nullptr, data->ctrl) != ARMPLANE_OK) {
            armplane_law_state state;
            armplane_law_get_state(law.get(), &state);
            throw std::runtime_error(state.reason);
        }
        armplane_law_state state;
        armplane_law_get_state(law.get(), &state);
        engaged += std::any_of(state.modes, state.modes + state.mode_count, [](const auto& one) { return one.beta < 1.0; });
        mj_step(model.get(), data.get());
        crossings += (bend < 0.0) != (data->qpos[4] < 0.0);
        bend = data->qpos[4];
        for (int i = 0; i < 3; ++i) pose[i] += dt * twist[i];
        mj_kinematics(model.get(), data.get());
        const double* hand = data->site_xpos + 3 * tip;
        off = std::max(off, std::hypot(hand[0] - pose[0], hand[1] - pose[1]));
    }
    const double left = mju_dist3(data->site_xpos + 3 * tip, pose);
    std::printf("%zu joints, MuJoCo %s: through the wrist lock %d times, %d steps in a neighbourhood, %.3f mm off the line, %.3f mm off at its end\n",
                n, mj_versionString(), crossings, engaged, 1e3 * off, 1e3 * left);
    return crossings > 0 && engaged > 0 && off < 1e-3 && left < 1e-3 ? 0 : 1;
}

}  // namespace

int main(int count, char** arguments) {
    try {
        return run(count > 2 ? arguments[1] : "arm.xml", count > 2 ? arguments[2] : "arm.urdf");
    } catch (const std::exception& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 2;
    }
}
