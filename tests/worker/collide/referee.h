// SPDX-License-Identifier: Apache-2.0
// MuJoCo's own collision detection as the independent reference of worker/collide. The simulation's masks keep the arm
// from touching itself; the referee's own copy of the model has none.
#pragma once

#include <mujoco/mujoco.h>

#include <algorithm>
#include <map>
#include <set>
#include <string>
#include <utility>

#include "worker/sim/model.h"

namespace etude::collide {

class Referee {
 public:
  explicit Referee(const sim::Scene& scene)
      : scene_(scene.model()), model_(mj_copyModel(nullptr, scene_.mj.get())), data_(mj_makeData(model_.get())) {
    std::fill_n(model_->geom_contype, model_->ngeom, 0);
    std::fill_n(model_->geom_conaffinity, model_->ngeom, 0);
    model_->opt.disableflags |= mjDSBL_FILTERPARENT;
  }
  const mjModel* model() const { return model_.get(); }
  mjData* data() { return data_.get(); }

  /// Objects stay where PlaceObject put them last, the others where SetHome does.
  void PlaceObject(const std::string& name, const Pose& X_WO) { objects_[name] = X_WO; }
  void Place(const Eigen::VectorXd& q, double gripper) {
    scene_.SetHome(data_->qpos);
    for (const auto& [name, body] : scene_.objects) {
      data_->qpos[body.q + 3] = 1;
      const auto it = objects_.find(name);
      if (it == objects_.end()) continue;
      const Pose& X_WO = it->second;
      const double qpos[7] = {X_WO.p.x(), X_WO.p.y(), X_WO.p.z(), X_WO.q.w(), X_WO.q.x(), X_WO.q.y(), X_WO.q.z()};
      std::copy_n(qpos, 7, data_->qpos + body.q);
    }
    scene_.SetArm(data_->qpos, q);
    scene_.SetGripper(data_->qpos, gripper);
    mj_kinematics(model_.get(), data_.get());
  }

  /// Do two geoms come closer than `margin`?
  bool Within(int a, int b, double margin) {
    model_->geom_contype[a] = model_->geom_conaffinity[b] = 1;
    model_->geom_margin[a] = model_->geom_margin[b] = margin;
    mj_collision(model_.get(), data_.get());
    bool within = false;
    for (int i = 0; i < data_->ncon; ++i) within |= data_->contact[i].dist < margin;
    model_->geom_contype[a] = model_->geom_conaffinity[b] = 0;
    model_->geom_margin[a] = model_->geom_margin[b] = 0;
    return within;
  }

  /// Names of the bodies in contact, the collidable geoms of one body against those of all others.
  std::set<std::pair<std::string, std::string>> Contacts() {
    for (int geom = 0; geom < model_->ngeom; ++geom) {
      const bool collides = scene_.mj->geom_contype[geom] || scene_.mj->geom_conaffinity[geom];
      model_->geom_contype[geom] = model_->geom_conaffinity[geom] = collides ? 1 : 0;
    }
    mj_collision(model_.get(), data_.get());
    std::set<std::pair<std::string, std::string>> pairs;
    const auto name = [&](int geom) {
      const int body = model_->geom_bodyid[geom];
      return std::string(body == 0 ? "world" : mj_id2name(model_.get(), mjOBJ_BODY, body));
    };
    for (int i = 0; i < data_->ncon; ++i) {
      const mjContact& contact = data_->contact[i];
      if (contact.dist > 0) continue;
      pairs.emplace(name(contact.geom1), name(contact.geom2));
      pairs.emplace(name(contact.geom2), name(contact.geom1));
    }
    std::fill_n(model_->geom_contype, model_->ngeom, 0);
    std::fill_n(model_->geom_conaffinity, model_->ngeom, 0);
    return pairs;
  }

 private:
  const sim::Scene::Model& scene_;
  sim::ModelPtr model_;
  sim::DataPtr data_;
  std::map<std::string, Pose> objects_;
};

}  // namespace etude::collide
