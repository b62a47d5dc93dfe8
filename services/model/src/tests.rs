//! Golden data, algorithms that check each other, and refusals.

use crate::{Robot, RobotError, RobotText};

mod golden;
mod identities;
mod loading;

fn load(urdf: &str, description: &str) -> Result<Robot, RobotError> {
    Robot::from_source(&RobotText {
        name: "r".to_owned(),
        description: description.to_owned(),
        urdf: urdf.to_owned(),
        ..RobotText::default()
    })
}

/// Joints of every kind, axes in odd directions, inertias with all products, fixed links with mass.
const ODD: &str = r#"
<robot name="odd">
  <link name="ground"/>
  <link name="a"><inertial><origin xyz="0.1 -0.2 0.05" rpy="0.3 0.1 -0.4"/><mass value="3"/>
    <inertia ixx="0.03" ixy="0.002" ixz="-0.004" iyy="0.04" iyz="0.003" izz="0.05"/></inertial></link>
  <link name="b"><inertial><origin xyz="0 0.1 0.2" rpy="0 0.2 0"/><mass value="2"/>
    <inertia ixx="0.02" ixy="-0.003" ixz="0.001" iyy="0.03" iyz="0.002" izz="0.025"/></inertial></link>
  <link name="weight"><inertial><origin xyz="0.02 0 0.03" rpy="0.1 0.2 0.3"/><mass value="1.5"/>
    <inertia ixx="0.004" ixy="0.001" ixz="0" iyy="0.005" iyz="0" izz="0.006"/></inertial></link>
  <link name="c"><inertial><origin xyz="0.1 0 0" rpy="0 0 0"/><mass value="1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.012" iyz="0.001" izz="0.011"/></inertial></link>
  <link name="tool"/>
  <joint name="turn" type="revolute"><parent link="ground"/><child link="a"/><origin xyz="0.1 0.2 0.3" rpy="0.4 -0.2 0.7"/>
    <axis xyz="1 -2 0.5"/><limit lower="-3" upper="3" effort="50" velocity="2"/></joint>
  <joint name="slide" type="prismatic"><parent link="a"/><child link="b"/><origin xyz="0 0.3 0.1" rpy="-0.5 0.3 0.2"/>
    <axis xyz="0.3 0.4 -1"/><limit lower="-3" upper="3" effort="50" velocity="2"/></joint>
  <joint name="bolt" type="fixed"><parent link="b"/><child link="weight"/><origin xyz="0.05 0.1 0.15" rpy="0.6 0.1 -0.2"/></joint>
  <joint name="spin" type="continuous"><parent link="weight"/><child link="c"/><origin xyz="0.2 -0.1 0" rpy="1.1 0 0.3"/>
    <axis xyz="-1 0 0"/><dynamics damping="0.5" friction="0.1"/></joint>
  <joint name="grip" type="fixed"><parent link="c"/><child link="tool"/><origin xyz="0.1 0.05 0.2" rpy="0 0.4 0.1"/></joint>
</robot>"#;
