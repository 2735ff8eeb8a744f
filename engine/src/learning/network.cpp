#include "learning/network.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "base/philox.hpp"

namespace flockstep::learning {
namespace {

std::vector<Layer> layers_of(std::size_t in, const std::vector<int>& hidden, std::size_t out, Activation activation,
                             Network& network) {
  std::vector<Layer> layers;
  const auto add = [&](std::size_t size, After after) {
    Layer layer{
        .in = in, .out = size, .weight = network.num_padded, .bias = 0, .transposed = network.num_transposed, .after = after};
    layer.bias = layer.weight + size * padded(in);
    network.num_padded = layer.bias + padded(size);
    network.num_transposed += in * padded(size);
    layers.push_back(layer);
    in = size;
  };
  for (const int size : hidden) {
    add(static_cast<std::size_t>(size), activation == Activation::tanh ? After::tanh : After::relu);
  }
  add(out, After::nothing);
  return layers;
}

}  // namespace

Network::Network(const NetworkConfig& config) {
  const auto in = static_cast<std::size_t>(config.input_size()), actions = static_cast<std::size_t>(config.action_size);
  if (!config.is_discrete) num_padded = padded(actions);
  actor = layers_of(in, config.actor_layers, actions, config.activation, *this);
  critic = layers_of(in, config.critic_layers, 1, config.activation, *this);
  const auto add = [&](const std::string& name, std::vector<int> shape, Place place) {
    std::size_t count = 1;
    for (const int size : shape) count *= static_cast<std::size_t>(size);
    infos.push_back({name, std::move(shape), num_parameters});
    places_.push_back(place);
    num_parameters += count;
  };
  const auto add_layer = [&](const std::string& name, const Layer& layer) {
    add(name + ".weight", {static_cast<int>(layer.out), static_cast<int>(layer.in)}, {&layer, true});
    add(name + ".bias", {static_cast<int>(layer.out)}, {&layer, false});
  };
  // In PyTorch's lists of layers, activations have numbers, too.
  const auto add_hidden = [&](const std::string& name, const std::vector<Layer>& layers) {
    for (std::size_t i = 0; i + 1 < layers.size(); ++i) add_layer(name + '.' + std::to_string(2 * i), layers[i]);
  };
  if (!config.is_discrete) add("log_std", {config.action_size}, {nullptr, false});
  add_hidden("mlp_extractor.policy_net", actor);
  add_hidden("mlp_extractor.value_net", critic);
  add_layer("action_net", actor.back());
  add_layer("value_net", critic.back());
}

template <class F>
void Network::for_each_run(const F& f) const {
  for (std::size_t i = 0; i < infos.size(); ++i) {
    const auto [layer, is_weight] = places_[i];
    const auto count = static_cast<std::size_t>(infos[i].shape.back());
    if (layer == nullptr) {
      f(infos[i].first, log_std, count);
    } else if (!is_weight) {
      f(infos[i].first, layer->bias, count);
    } else {
      for (std::size_t o = 0; o < layer->out; ++o) f(infos[i].first + o * count, layer->weight + o * padded(count), count);
    }
  }
}

void Network::unpack(std::span<const float> plain, std::span<float> padded) const {
  for_each_run(
      [&](std::size_t from, std::size_t to, std::size_t count) { std::copy_n(plain.data() + from, count, padded.data() + to); });
}

std::vector<float> Network::packed(std::span<const float> padded) const {
  std::vector<float> plain(num_parameters);
  for_each_run(
      [&](std::size_t to, std::size_t from, std::size_t count) { std::copy_n(padded.data() + from, count, plain.data() + to); });
  return plain;
}

void Network::initialise(std::uint64_t seed, std::span<float> padded_values) const {
  std::fill(padded_values.begin(), padded_values.end(), 0.0F);
  std::uint32_t number = 0;
  const auto fill = [&](const std::vector<Layer>& layers, double last_gain) {
    for (const Layer& layer : layers) {
      const double gain = &layer == &layers.back() ? last_gain : std::sqrt(2.0);
      const auto rows = static_cast<Eigen::Index>(layer.out), columns = static_cast<Eigen::Index>(layer.in);
      // As PyTorch's orthogonal_(): Q of a random matrix, with signs that make its distribution uniform.
      Eigen::MatrixXd random(std::max(rows, columns), std::min(rows, columns));
      std::uint32_t index = 0;
      for (Eigen::Index i = 0; i < random.size(); ++i) {
        random.data()[i] = normal_pair(
            philox4x32({index++, number, 0, 0}, {static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32U)}))[0];
      }
      ++number;
      const Eigen::HouseholderQR<Eigen::MatrixXd> qr(random);
      Eigen::MatrixXd q = qr.householderQ() * Eigen::MatrixXd::Identity(random.rows(), random.cols());
      for (Eigen::Index i = 0; i < q.cols(); ++i) {
        if (qr.matrixQR()(i, i) < 0) q.col(i) *= -1.0;
      }
      if (rows < columns) q.transposeInPlace();
      for (Eigen::Index o = 0; o < rows; ++o) {
        float* const to = padded_values.data() + layer.weight + static_cast<std::size_t>(o) * padded(layer.in);
        for (Eigen::Index i = 0; i < columns; ++i) to[i] = static_cast<float>(gain * q(o, i));
      }
    }
  };
  fill(actor, 0.01);
  fill(critic, 1.0);
}

void Network::transpose_all(const AlignedVector<float>& parameters, AlignedVector<float>& transposed) const {
  for (const Layer& layer : actor) transpose(layer, parameters.data(), transposed.data());
  for (const Layer& layer : critic) transpose(layer, parameters.data(), transposed.data());
}

}  // namespace flockstep::learning
