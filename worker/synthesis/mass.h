// SPDX-License-Identifier: Apache-2.0
// What follows from the shape of a closed mesh: is it closed, volume, centre, inertia; and its vertex normals.
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "worker/assets/mesh.h"

namespace etude::synthesis {

/// Of a solid of density 1: mass is volume.
struct MassProperties {
  double mass = 0;                                    ///< kg (m^3 at density 1)
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();   ///< centre of mass, m
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();  ///< about the centre, along the axes of the mesh, kg m^2

  MassProperties Scaled(double density) const { return {mass * density, centre, inertia * density}; }
};

/// Integrals over the inside of a closed mesh, as sums over its faces by the divergence theorem.
/// The volume is negative when the mesh is wound inwards.
MassProperties Integrate(const assets::Mesh& mesh);

/// Several bodies as one rigid body.
MassProperties Sum(const std::vector<MassProperties>& parts);

/// Inertia along its principal axes.
struct PrincipalInertia {
  Eigen::Vector3d moments = Eigen::Vector3d::Zero();         ///< kg m^2, ascending
  Eigen::Quaterniond axes = Eigen::Quaterniond::Identity();  ///< turns the principal axes into the body's
};
PrincipalInertia Diagonalise(const Eigen::Matrix3d& inertia);

/// True when every edge has exactly two faces, running through it in opposite directions. Vertices at the same place
/// count as one, so that seams of the texture do not matter.
bool IsWatertight(const assets::Mesh& mesh);

/// The area of the smallest face, m^2; 0 for no faces.
double SmallestFace(const assets::Mesh& mesh);

/// How many parts the faces hang together in, by shared vertices; vertices at the same place count as one.
int CountParts(const assets::Mesh& mesh);

/// Winds the faces of a watertight mesh so that they are seen from outside, part by part: a part whose volume is
/// negative is turned, unless it lies in another one, whose hollow it is.
void TurnOutward(assets::Mesh& mesh);

/// Vertex normals as area-weighted means of the faces around.
void ComputeNormals(assets::Mesh& mesh);

}  // namespace etude::synthesis
