// SPDX-License-Identifier: Apache-2.0
// Asks a policy that `etude checkpoint export --format torchscript` wrote, with libtorch and nothing of Etude.
//   torchscript POLICY.pt                     says what it takes: etude.json, which lies inside
//   torchscript POLICY.pt HEIGHT WIDTH JOINTS   waypoints for a black crop, joints at 0 and the word 0
//   torchscript POLICY.pt INPUTS.pt           for a tuple (crop, joints, token_ids[, viewpoint]), as torch.save writes
//   it
// Prints a line a waypoint: x y z (m), six numbers of its rotation, gripper.
#include <torch/script.h>

#include <cstdio>
#include <fstream>
#include <iterator>

torch::jit::Stack Zeros(char** sizes) {
  return {torch::zeros({1, 3, std::stoi(sizes[0]), std::stoi(sizes[1])}, torch::kUInt8),
          torch::zeros({1, std::stoi(sizes[2])}), torch::zeros({1, 1}, torch::kInt64)};
}

torch::jit::Stack Read(const char* path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error(std::string("cannot open '") + path + "'");
  const std::vector<char> bytes{std::istreambuf_iterator<char>(file), {}};
  return torch::jit::pickle_load(bytes).toTupleRef().elements().vec();
}

void Ask(int count, char** arguments) {
  torch::jit::ExtraFilesMap files{{"etude.json", ""}};
  torch::jit::Module policy = torch::jit::load(arguments[1], c10::nullopt, files);
  if (count == 2) return void(std::puts(files["etude.json"].c_str()));
  const torch::NoGradGuard no_grad;
  const torch::Tensor waypoints = policy.forward(count == 3 ? Read(arguments[2]) : Zeros(arguments + 2)).toTensor();
  for (std::int64_t i = 0; i < waypoints.size(0); ++i)
    for (std::int64_t k = 0; k < waypoints.size(1); ++k)
      std::printf("%.9g%c", waypoints[i][k].item<double>(), k + 1 < waypoints.size(1) ? ' ' : '\n');
}

int main(int count, char** arguments) {
  if (count != 2 && count != 3 && count != 5) {
    std::fputs("usage: torchscript POLICY.pt [INPUTS.pt | HEIGHT WIDTH JOINTS]\n", stderr);
    return 2;
  }
  try {
    Ask(count, arguments);
  } catch (const std::exception& error) {
    return std::fprintf(stderr, "%s\n", error.what()), 3;
  }
}
