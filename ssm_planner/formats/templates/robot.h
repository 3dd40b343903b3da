{{ comment }}
#ifndef SSM_ROBOT_H
#define SSM_ROBOT_H

/* Double precision; compiled with -DSSM_FLOAT32 single precision. One program may hold both forms. */
{{ real }}
#ifdef SSM_FLOAT32
{% for name in names %}
#define {{ name }} {{ name }}_f32
{% endfor %}
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* Limits of the joints and their motors, SI units; INFINITY where there is none. */
{% for name, _ in limits %}
extern const ssm_real {{ name }}[4];
{% endfor %}

{% for declaration, about in functions %}
/* {{ about }} */
{{ declaration }};

{% endfor %}
#ifdef __cplusplus
}
#endif

#endif
