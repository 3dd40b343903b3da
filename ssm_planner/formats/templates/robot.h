{{ comment }}
#ifndef SSM_ROBOT_H
#define SSM_ROBOT_H

/* The precision is double, or single with -DSSM_FLOAT32. One program may contain both. */
{{ real }}
#ifdef SSM_FLOAT32
{% for name in names %}
#define {{ name }} {{ name }}_f32
{% endfor %}
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* Limits of the joints and their motors in SI units. INFINITY means that there is no limit. */
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
