// SPDX-License-Identifier: Apache-2.0
// A policy as data: the module graph, the encoders and their sizes. trainer/experiments/*.yaml are
// such files, and so is every ablation. No torch here.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/language/tokenizer.h"
#include "trainer/policy/quantities/losses.h"

namespace etude::policy {

/// One layer of an image encoder: conv (+ norm + ReLU), or a residual block of two 3x3 convs.
struct ImageLayer {
  std::string kind = "conv";  ///< conv | residual
  int channels = 32;
  int kernel = 3;                 ///< conv only
  int stride = 1;                 ///< conv only
  std::string norm = "batch";     ///< batch | instance | none
  std::string padding = "zeros";  ///< zeros | reflect

  void Visit(auto& v) {
    v("kind", kind, "", "conv | residual: a block of two 3x3 convolutions");
    v("channels", channels, "-", "that it puts out");
    v("kernel", kernel, "px", "edge of the window, of conv only");
    v("stride", stride, "px", "of conv only");
    v("norm", norm, "", "batch | instance | none");
    v("padding", padding, "", "zeros | reflect");
  }
};

struct ImageConfig {
  /// Region of the camera's picture that the network sees, px: u0, v0, width, height. Empty: ResolveCrop (crop.h)
  /// derives it from the camera and `work_volume`; a checkpoint has the numbers.
  std::vector<int> crop;
  /// Where objects and hand are, m, world: x from, to; y from, to; z from, to.
  std::vector<double> work_volume{-0.43, 0.43, 0.0, 0.42, 0.0, 0.32};
  std::vector<ImageLayer> layers;
  std::string position = "fourier";  ///< fourier (absolute pixel coordinates) | index (the original's)
  double pixel_mean = 60;            ///< 0..255; pixels enter as (x - mean) / scale
  double pixel_scale = 60;           ///< > 0

  void Visit(auto& v) {
    v("crop", crop, "px", "u0, v0, width, height of what the network sees; none: derived from camera and work_volume");
    v("work_volume", work_volume, "m", "x from, to; y from, to; z from, to: what a derived crop holds");
    v("layers", layers, "", "of the image encoder, first to last");
    v("position", position, "", "fourier: absolute pixel coordinates | index: of the token");
    v("pixel_mean", pixel_mean, "-", "of 0..255: a pixel enters as (x - mean) / scale");
    v("pixel_scale", pixel_scale, "-", "of 0..255, > 0");
  }
};

struct LanguageConfig {
  /// default (the mean of trained word vectors) | conv (convolutions over them, which know their order) | clip:DIR
  /// (CLIP's text tower out of a folder, frozen; clip/text_encoder.h). A file may say `language: clip:DIR` for
  /// `language: {encoder: clip:DIR}`.
  std::string encoder = "default";
  int buckets = 8192;  ///< hashed features, see services/language/tokenizer.h; not of clip
  int width = 64;      ///< word vector; not of clip
  int hidden = 128;    ///< of the perceptron, and channels of conv; not of clip
  /// Words enter also as what WordNet says that they may mean (services/language/senses.h), so that the ones that no
  /// training sentence has are understood by what they have in common with others; not of clip. Wherever the policy is
  /// built it needs the same WordNet.
  bool senses = false;
  /// Of clip's folder (clip::TextEncoder::sha256), or of WordNet where there are senses. Empty: whatever is there when
  /// training begins; a checkpoint has it.
  std::string sha256;

  void Visit(auto& v) {
    v("encoder", encoder, "",
      "default: the mean of trained word vectors | conv: convolutions over them | clip:DIR: CLIP's text tower "
      "out of that folder, frozen");
    v("buckets", buckets, "-", "hashed word features, not of clip");
    v("width", width, "-", "of a word vector, not of clip");
    v("hidden", hidden, "-", "width of the hidden layer, and channels of conv; not of clip");
    v("senses", senses, "",
      "words enter also as what WordNet (package wordnet-base, where it serves, too) says that they may mean; not of "
      "clip");
    v("sha256", sha256, "",
      "of the content of clip's folder, or of WordNet; empty: of what it holds when training begins");
  }

  /// Of clip:DIR; "" of the others.
  std::string clip_folder() const;
  /// Of the table of word vectors.
  int rows() const { return buckets + (senses ? language::kSenseBuckets : 0); }
};

/// What a module decodes its register into: a quantity of an entity.
struct DecoderConfig {
  /// target | reference | obstacle | ee | command | object:NAME, see trainer/data/labels.h. Empty with `quantity`: no
  /// decoder.
  std::string entity;
  std::string
      quantity;  ///< class | task | pixel | position | pose | displacement | trajectory, see quantities/quantity.h
  /// linear (no hidden layer) | mlp | soft_argmax (pixel: the expectation of its attention, plus what the network adds)
  /// | difference (displacement: position of from[1] - position of from[0], plus ...) | relative (trajectory: offsets
  /// from the position of from[0]) | ray (position: where the pixel of from[0] looks, through the camera that took the
  /// picture, at the height that the network says, plus ...) | correction (trajectory: that of from[0], plus ...).
  std::string readout = "linear";
  std::vector<std::string> from;  ///< modules that difference, relative, ray and correction refer to
  std::string rotation = "6d";    ///< of a pose or a trajectory: 6d | euler_sincos (as printed in the paper)
  std::vector<int> hidden;        ///< widths of hidden layers
  /// What it reads, concatenated. Of its own: register, soft_argmax (per head and their mean),
  /// joints (normalised), joint_token (what the joint encoder makes of them), language (the sentence's token). Of an
  /// earlier module M: register:M,
  /// soft_argmax:M, class:M, task:M (probabilities), pixel:M, position:M, displacement:M (decoded,
  /// normalised), trajectory:M (its form: offsets from its first waypoint, normalised, and the gripper), and
  /// fourier:position:M, fourier:displacement:M (Fourier features: sines and cosines of several wavelengths, for
  /// decisions about millimetres), and fourier:joints (sine and cosine of each joint's angle, what kinematics is made
  /// of).
  std::vector<std::string> inputs{"register"};
  /// Decoded inputs carry no gradient back into the modules that they come from.
  bool detach = true;
  double weight = 1;  ///< of its loss

  void Visit(auto& v) {
    v("entity", entity, "", "target | reference | obstacle | ee | command | object:NAME");
    v("quantity", quantity, "", "class | task | pixel | position | pose | displacement | trajectory");
    v("readout", readout, "", "linear | mlp | soft_argmax | difference | relative | ray | correction");
    v("from", from, "", "modules that difference (two), relative, ray and correction (one) refer to");
    v("rotation", rotation, "", "6d | euler_sincos, of a pose or a trajectory");
    v("hidden", hidden, "-", "widths of hidden layers");
    v("inputs", inputs, "",
      "what it reads, concatenated: register, joints, joint_token, language, or KIND:MODULE of an earlier module");
    v("detach", detach, "", "decoded inputs carry no gradient back into the modules they come from");
    v("weight", weight, "-", "of its loss");
  }

  /// "target.position", the key of its label; "" without decoder.
  std::string label() const { return quantity.empty() ? "" : entity + "." + quantity; }
};

/// A subtask: a query attends, is supervised where to attend, and decodes.
struct ModuleConfig {
  std::string name;   ///< LANG, EE2D, TAR2D, ...
  int level = 1;      ///< order of evaluation; also the curriculum's subtask by default
  std::string query;  ///< "" own learned register; else an earlier module
  /// Keys it may read: image, language, joints, self, and earlier modules (of lower levels, or of
  /// its own level and above it in the list); "all" = image, language, joints and every module of
  /// lower levels.
  std::vector<std::string> reads{"all"};
  /// It reads the picture through an encoder of its own, built as the policy's: a module that is added to a trained
  /// policy may then look for what nothing in the frozen tokens tells. Only with attention: module.
  bool own_image = false;
  /// Supervised attention: the summed attention on this key set is driven to 1. language, joints,
  /// self, MODULE, or image@ENTITY (image@target, image@others): the image tokens under it. Empty: not supervised.
  std::vector<std::string> attend;
  double attend_weight = 1;
  /// Registers that it reads carry no gradient back (control noise cannot spoil grounding); tokens
  /// do, and registers of modules that decode nothing, which nothing else trains.
  bool detach = false;
  DecoderConfig decoder;

  void Visit(auto& v) {
    v("name", name, "", "of the module, e.g. TAR2D");
    v("level", level, "-", "order of evaluation, and the subtask of the curriculum");
    v("query", query, "", "an earlier module; empty: a learned register of its own");
    v("reads", reads, "", "keys of its attention: image, language, joints, self, earlier modules, or all");
    v("own_image", own_image, "", "it reads the picture through an encoder of its own, built as the policy's");
    v("attend", attend, "", "keys that its attention is supervised to: language, joints, self, MODULE, image@ENTITY");
    v("attend_weight", attend_weight, "-", "of the loss of supervised attention");
    v("detach", detach, "", "registers that it reads carry no gradient back");
    v("decoder", decoder, "", "what it puts out");
  }
};

struct PolicyConfig {
  std::string name = "compact";
  ImageConfig image;
  LanguageConfig language;
  std::vector<int> joint_hidden{128, 128};  ///< joint encoder, then `width`
  /// It reads sine and cosine of each joint's angle too, what kinematics is made of.
  bool joint_fourier = false;
  int width = 64;  ///< d, of every token and register
  int heads = 4;
  std::string attention = "module";  ///< module (own parameters) | shared (the paper's, per level)
  std::string activation = "silu";   ///< silu | selu | relu, of decoders and joint encoder
  std::vector<std::string> objects{"cube", "coke", "pepsi", "milk", "bread", "bottle"};  ///< LANG's classes
  /// What modules that decode the command's task tell apart. Empty: the built-in tasks and the dataset's own; a
  /// checkpoint has them all.
  std::vector<std::string> tasks;
  /// Of the convolutions: bf16 (on CUDA, and where the CPU is fast at it, see HasFastBf16; else float32) | float32.
  std::string precision = "bf16";
  /// Parts (parts.h) that know one robot: with another one they begin anew.
  std::vector<std::string> robot_specific;
  LossesConfig losses;
  std::vector<ModuleConfig> modules;

  void Visit(auto& v) {
    v("name", name, "", "of the policy");
    v("image", image, "", "encoder of the picture");
    v("language", language, "", "encoder of the sentence");
    v("joint_hidden", joint_hidden, "-", "hidden widths of the joint encoder");
    v("joint_fourier", joint_fourier, "", "the joint encoder reads sine and cosine of each joint's angle too");
    v("width", width, "-", "of every token and register");
    v("heads", heads, "-", "of each attention");
    v("attention", attention, "", "module: parameters of its own | shared: one set a level, as in the paper");
    v("activation", activation, "", "silu | selu | relu, of decoders and joint encoder");
    v("objects", objects, "", "classes that it tells apart");
    v("tasks", tasks, "", "tasks that it tells apart; none: the built-in ones and the dataset's own");
    v("precision", precision, "", "of the image's convolutions: bf16 (float32 on a CPU without AVX-512) | float32");
    v("robot_specific", robot_specific, "", "parts that know one robot: with another one they begin anew");
    v("losses", losses, "", "what errors cost");
    v("modules", modules, "", "the graph");
  }

  /// All problems at once: names, levels (no cycles), reads, labels, sizes.
  Status Validate() const;
};

}  // namespace etude::policy
