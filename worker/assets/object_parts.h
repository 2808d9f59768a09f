// SPDX-License-Identifier: Apache-2.0
// Surfaces and pictures of the objects (used by object.cc and its tests only).
#pragma once

#include "worker/assets/canvas.h"
#include "worker/assets/mesh.h"

namespace etude::assets {

// dimensions in m, heights above the lowest point
inline constexpr double kCanRadius = 0.025, kCanHeight = 0.080;
inline constexpr double kMilkHalf = 0.020, kMilkShoulder = 0.106, kMilkRidge = 0.134, kMilkHeight = 0.144;
inline constexpr double kMilkFin = 0.002;  ///< half thickness of the sealed ridge
inline constexpr double kBreadHalfX = 0.030, kBreadHalfY = 0.025, kBreadSide = 0.056, kBreadHeight = 0.075;
inline constexpr double kBottleRadius = 0.0275, kBottleShoulder = 0.092, kBottleNeck = 0.122;
inline constexpr double kBottleNeckRadius = 0.0125, kBottleHeight = 0.160;

inline constexpr double kBallRadius = 0.050;

Mesh BallMesh();  ///< about its middle

/// All meshes have their lowest point at z = -rest_height.
Mesh CanMesh(double rest_height);
Mesh MilkMesh(double rest_height);
Mesh MilkGableHull(double rest_height);  ///< convex collision piece
Mesh BreadMesh(double rest_height);
Mesh BottleMesh(double rest_height);
Mesh BottleLabelMesh(double rest_height);
Mesh BottleCapMesh(double rest_height);
Mesh BottleShoulderHull(double rest_height);  ///< convex collision piece

Canvas CokeTexture();
Canvas PepsiTexture();
Canvas MilkTexture();
Canvas BreadTexture();
Canvas BottleLabelTexture();
Canvas WoodTexture();
Canvas BallTexture(const Color& colour);  ///< u around the vertical, v from the upper pole to the lower
Canvas ClothTexture();
Canvas StoneTexture();

}  // namespace etude::assets
