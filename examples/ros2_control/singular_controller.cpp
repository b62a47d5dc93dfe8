// A ros2_control controller: the arm follows a twist of its hand, through singularities too. `on_configure` makes the law; `update` only steps it.
#include <libarmplane.h>

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "controller_interface/controller_interface.hpp"
#include "geometry_msgs/msg/twist_stamped.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "rclcpp/rclcpp.hpp"
#include "realtime_tools/realtime_buffer.hpp"

namespace armplane {

using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::return_type;

class SingularController : public controller_interface::ControllerInterface {
public:
    CallbackReturn on_init() override {
        auto_declare<std::string>("tip", "tool0");   // the link that is the end-effector
        auto_declare<std::string>("settings", "");   // keys of a scenario, one a line
        auto_declare<double>("timeout", 0.1);        // s, after which a twist no longer counts
        return CallbackReturn::SUCCESS;
    }

    InterfaceConfiguration command_interface_configuration() const override { return interfaces({"effort"}); }

    InterfaceConfiguration state_interface_configuration() const override { return interfaces({"position", "velocity"}); }

    CallbackReturn on_configure(const rclcpp_lifecycle::State&) override {
        const auto tip = get_node()->get_parameter("tip").as_string();
        const auto settings = get_node()->get_parameter("settings").as_string();
        timeout_ns_ = static_cast<std::int64_t>(1e9 * get_node()->get_parameter("timeout").as_double());
        char why[512];
        armplane_arm* arm = nullptr;
        armplane_law* law = nullptr;
        auto made = armplane_arm_create_from_text(ARMPLANE_ABI_VERSION, get_node()->get_name(), get_robot_description().c_str(), tip.c_str(),
                                                  nullptr, &arm, why, sizeof why);
        arm_.reset(arm);
        if (made == ARMPLANE_OK) {
            made = armplane_law_create(ARMPLANE_ABI_VERSION, arm, 1.0 / get_update_rate(), nullptr, settings.c_str(), &law, why, sizeof why);
            law_.reset(law);
        }
        if (made != ARMPLANE_OK) {
            RCLCPP_ERROR(get_node()->get_logger(), "%s", why);
            return CallbackReturn::ERROR;
        }
        joints_.clear();
        for (std::size_t i = 0; i < armplane_arm_joint_count(arm); ++i) {
            armplane_joint joint;
            armplane_arm_joint(arm, i, &joint);
            joints_.emplace_back(joint.name);
        }
        subscription_ = get_node()->create_subscription<geometry_msgs::msg::TwistStamped>(
            "~/twist", rclcpp::SystemDefaultsQoS(), [this](const std::shared_ptr<const geometry_msgs::msg::TwistStamped> message) {
                const auto &linear = message->twist.linear, &angular = message->twist.angular;
                asked_.writeFromNonRT({{linear.x, linear.y, linear.z, angular.x, angular.y, angular.z}, get_node()->now().nanoseconds()});
            });
        return CallbackReturn::SUCCESS;
    }

    CallbackReturn on_activate(const rclcpp_lifecycle::State&) override {
        asked_.writeFromNonRT({});
        armplane_law_reset(law_.get());
        return CallbackReturn::SUCCESS;
    }

    return_type update(const rclcpp::Time& time, const rclcpp::Duration&) override {
        const std::size_t n = joints_.size();
        std::array<double, ARMPLANE_JOINTS_MAX> q{}, qdot{}, tau{};
        for (std::size_t i = 0; i < n; ++i) {
            const auto position = state_interfaces_[2 * i].get_optional(), velocity = state_interfaces_[2 * i + 1].get_optional();
            if (!position || !velocity) return return_type::ERROR;
            q[i] = *position;
            qdot[i] = *velocity;
        }
        const Asked& asked = *asked_.readFromRT();
        const bool counts = time.nanoseconds() - asked.at_ns < timeout_ns_;
        const auto status =
            armplane_law_step(law_.get(), q.data(), qdot.data(), nullptr, counts ? asked.twist.data() : nullptr, nullptr, tau.data());
        if (status < ARMPLANE_OK) return return_type::ERROR;
        bool sent = true;
        for (std::size_t i = 0; i < n; ++i) sent = command_interfaces_[i].set_value(tau[i]) && sent;
        return sent ? return_type::OK : return_type::ERROR;
    }

private:
    struct Asked {
        std::array<double, 6> twist{};  // [linear; angular] in the axes of the base, m/s and rad/s
        std::int64_t at_ns = 0;
    };
    struct Destroy {
        void operator()(armplane_arm* arm) const { armplane_arm_destroy(arm); }
        void operator()(armplane_law* law) const { armplane_law_destroy(law); }
    };

    InterfaceConfiguration interfaces(const std::vector<std::string>& kinds) const {
        InterfaceConfiguration all{controller_interface::interface_configuration_type::INDIVIDUAL, {}};
        for (const auto& joint : joints_)
            for (const auto& kind : kinds) all.names.push_back(joint + "/" + kind);
        return all;
    }

    std::unique_ptr<armplane_arm, Destroy> arm_;
    std::unique_ptr<armplane_law, Destroy> law_;
    std::vector<std::string> joints_;
    std::int64_t timeout_ns_ = 0;
    realtime_tools::RealtimeBuffer<Asked> asked_;
    rclcpp::Subscription<geometry_msgs::msg::TwistStamped>::SharedPtr subscription_;
};

}  // namespace armplane

PLUGINLIB_EXPORT_CLASS(armplane::SingularController, controller_interface::ControllerInterface)
