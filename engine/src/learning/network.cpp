#include "learning/network.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "base/random.hpp"
#include "base/require.hpp"

namespace flockstep::learning {
namespace {

constexpr std::size_t kDirection = 3;  // numbers of a direction or an offset
constexpr float kDirectionGain = 2.0F;
constexpr float kNearest = 0.05F;  // fraction of the maximum range: keeps the logarithm finite
constexpr std::size_t kBlob = 2;   // offset and area of the blob
constexpr float kOffsetGain = 3.0F, kWidthGain = 5.0F;
constexpr float kNearPoint = 0.1F;  // m

// Emphasises near obstacles.
void write_nearness(const float* ranges, std::size_t count, float* to) {
  for (std::size_t i = 0; i < count; ++i) to[i] = -std::log(ranges[i] + kNearest);
}

}  // namespace

std::size_t input_size(Features features, std::size_t observation_size) {
  if (features == Features::blob) return observation_size + 1;
  if (features == Features::point) return observation_size + kDirection;
  return observation_size;
}

namespace {

// Writes the features of an observation.
void write_features(Features features, const float* observation, std::size_t observation_size, float* inputs) {
  switch (features) {
    case Features::flat:
      std::copy_n(observation, observation_size, inputs);
      return;
    case Features::goal:
      for (std::size_t i = 0; i < kDirection; ++i) inputs[i] = kDirectionGain * observation[i];
      write_nearness(observation + kDirection, observation_size - kDirection, inputs + kDirection);
      return;
    case Features::blob:
      inputs[0] = kOffsetGain * observation[0];
      inputs[1] = kWidthGain * std::sqrt(observation[1]);
      inputs[2] = observation[1] > 0.0F ? 1.0F : 0.0F;
      write_nearness(observation + kBlob, observation_size - kBlob, inputs + kBlob + 1);
      return;
    case Features::point: {
      const float x = observation[0], y = observation[1], z = observation[2];
      const float scale = 1.0F / (std::sqrt(x * x + y * y + z * z) + kNearPoint);
      for (std::size_t i = 0; i < kDirection; ++i) inputs[i] = observation[i] * scale;
      std::copy_n(observation, observation_size, inputs + kDirection);
      return;
    }
  }
}

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

void write_inputs(Features features, const float* observation, std::size_t actor_size, std::size_t size, float* inputs) {
  write_features(features, observation, actor_size, inputs);
  std::copy_n(observation + actor_size, size - actor_size, inputs + input_size(features, actor_size));
}

void pull_back_inputs(Features features, const float* observation, const float* d_inputs, std::size_t size,
                      float* d_observation) {
  require(features == Features::flat || features == Features::point, "features", "\"flat\" or \"point\", which have derivatives",
          "others");
  if (features == Features::flat) return void(std::copy_n(d_inputs, size, d_observation));
  std::copy_n(d_inputs + kDirection, size, d_observation);
  // The first inputs are observation / (length + kNearPoint).
  const float x = observation[0], y = observation[1], z = observation[2];
  const float length = std::sqrt(x * x + y * y + z * z), scale = 1.0F / (length + kNearPoint);
  const float along = x * d_inputs[0] + y * d_inputs[1] + z * d_inputs[2];
  const float turn = length > 0.0F ? along * scale * scale / length : 0.0F;
  for (std::size_t i = 0; i < kDirection; ++i) d_observation[i] += d_inputs[i] * scale - turn * observation[i];
}

Network::Network(const NetworkConfig& config) {
  const auto in = static_cast<std::size_t>(config.input_size()), actions = static_cast<std::size_t>(config.action_size);
  if (!config.is_discrete) num_padded = padded(actions);
  actor = layers_of(in - static_cast<std::size_t>(config.critic_only), config.actor_layers, actions, config.activation, *this);
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

Pass::Pass(const Network& network) : network_(network), inputs_(kRows * padded(network.critic.front().in)) {
  const std::size_t in = network.actor.front().in;
  if (in != network.critic.front().in) actor_inputs_.resize(kRows * padded(in));
  for (const auto& [layers, values] : {std::pair{&network.actor, &actor_}, std::pair{&network.critic, &critic_}}) {
    for (const Layer& layer : *layers) {
      const std::size_t count = kRows * padded(layer.out);
      values->push_back({AlignedVector<float>(count), AlignedVector<float>(count)});
    }
  }
}

void Pass::copy_actor_inputs(std::size_t rows) {
  const std::size_t in = network_.actor.front().in, stride = padded(network_.critic.front().in);
  for (std::size_t row = 0; row < rows; ++row) {
    std::copy_n(inputs_.data() + row * stride, in, actor_inputs_.data() + row * padded(in));
  }
}

const float* Pass::forward(const std::vector<Layer>& layers, const float* inputs, std::vector<Values>& values,
                           const float* parameters, const float* transposed, std::size_t rows) {
  const float* from = inputs;
  for (std::size_t i = 0; i < layers.size(); ++i) {
    learning::forward(layers[i], parameters, transposed, from, rows, values[i].outputs.data());
    from = values[i].outputs.data();
  }
  return from;
}

void Pass::backward(const std::vector<Layer>& layers, const float* inputs, std::vector<Values>& values, const float* parameters,
                    std::size_t rows, float* gradient) {
  for (std::size_t i = layers.size(); i-- > 0;) {
    const float* const from = i == 0 ? inputs : values[i - 1].outputs.data();
    add_gradient(layers[i], from, values[i].gradients.data(), rows, gradient);
    if (i > 0) {
      learning::backward(layers[i], parameters, values[i].gradients.data(), layers[i - 1].after, from, rows,
                         values[i - 1].gradients.data());
    }
  }
}

}  // namespace flockstep::learning
